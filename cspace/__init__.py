"""Certified configuration-space maps for motion planning.

A map says which configurations of a robot are proven free of collisions (FREE), which are proven
to collide (BLOCKED), and which are undecided (MIXED).

>>> import numpy as np, cspace, planners
>>> workspace = cspace.Workspace.from_array(np.eye(40, dtype=bool), spacing=0.1)
>>> space = cspace.build(workspace, cspace.Robot.rectangle(0.4, 0.3), rotations=36)
>>> space.is_free((0.5, 3.0, 0.0))
True
>>> planners.plan(space, (0.5, 3.0, 0.0), (2.0, 3.5, 1.0)).certified
True

:class:`Workspace` holds the obstacles, :class:`Robot` the shape; :func:`build` makes the map, a
:class:`CSpace`, and :func:`cspace.open` reads a saved one. :class:`Gate` proves commands before a
robot executes them, :mod:`cspace.lanes` route graphs, and :mod:`cspace.arms` arms.
"""

from cspace._support import attach_stub, refuse_other_planners

refuse_other_planners()

# The stub lists the public names. Each is imported at its first use, so that importing the package
# costs next to nothing.
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

__version__ = "1.0.0rc1"
