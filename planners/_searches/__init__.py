"""Searches: paths on maps, found without OMPL, and the objectives that they minimise.

A search takes a map, edges, start and goal, and gives a path, which the caller proves.

Words that the modules of this package share:

- *chain*: cells of a map, each beside the next, that a search goes through.
- *tube*: all configurations within some distances of a motion.
- *block*: a cube of cells that a guide treats as one node.
- *guide*: a search over blocks from the goal, which estimates costs for a search over cells.
- *run*: a row of FREE cells along the last axis, as long as possible.
- *lattice*: the cells and headings at which a search keeps one configuration.
"""
