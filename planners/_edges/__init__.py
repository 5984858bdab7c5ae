"""Edges: the motions of a drive between two configurations, their proofs, lengths and costs.

:func:`planners._edges.drives.local_planner` takes a space and a drive, and gives a
:class:`planners._edges.local_planner.LocalPlanner`, which answers for each edge.

Words that the modules of this package share:

- *edge*: a motion between two configurations, along a straight line, turns or a curve.
- *word*: the curve of a car, of at most five straight lines and arcs.
- *piece*: a short part of an edge.
- *factor*: the cost of a metre in a cell, 1 or above.
"""
