"""Exact queries: geometry decides wherever the map cannot.

Words that the modules of this package share:

- *boundary*: triangles, segments and points between a solid and the rest, in connected parts.
- *anchor*: a point of a part, which shows on which side of another solid the part lies.
- *cap*: what closes an obstacle where a side of the grid cuts it.
- *wall*: a side of the grid.
- *advance*: the fraction of a motion in the plane that one distance proves.

FREE and BLOCKED cells answer at once. In MIXED cells and outside the grid, the distance between the
boundaries of robot and obstacles decides. If the boundaries are apart, one point of each connected
part shows whether the part lies inside the other solid. A distance proves a whole neighbourhood: if
a motion moves the reference point by dx and rotates the robot by an angle, no point of the robot
moves by more than ``|dx| + rho * angle``, where rho is the longest lever of the robot (conservative
advancement: B. Mirtich, "Impulse-based dynamic simulation of rigid body systems", 1996). Along a
line, points move by less. In space, robots are bodies of :mod:`cspace._bodies`
(``cspace/_exact/rigid.py``). In the plane, which lies at z = 0, their segments are measured
(``cspace/_exact/segment_proofs.py``).

*Rounding.* All sets are closed: touching is a collision. A distance must exceed the margin by
``ANGLE_SLACK`` (1e-9) times the span of the robot, if it rotates, plus ``DISTANCE_ROUNDING``
(1e-12) times the largest coordinates of the map, the robot and the configurations. The first term
covers yaws that wrapping has rounded. The second term covers placing a point (relative 2^-53 a
step) and measuring a distance, with a factor of fifty to spare. Distances are proven by projections
onto lines.
"""
