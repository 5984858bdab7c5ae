"""Maps of two or three joints: each cell, a box of configurations, is proven FREE or BLOCKED.

They take an arm among obstacles, and give a :class:`cspace.CSpace`. A *block* is a group of cells
that is tested as one.
"""
