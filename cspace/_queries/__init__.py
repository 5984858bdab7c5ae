"""Queries of a map over one record.

Words that the modules of this package share:

- *tube*: all configurations within some distances of a motion.
- *chain*: cells, each beside the next.
- *block*: a cube of cells that is taken as one.
"""
