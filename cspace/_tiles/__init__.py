"""Maps larger than memory, stored as a folder of tiles (experimental).

Words that the modules of this package share:

- *interior*: the cells that belong to a tile; *halo*: the cells around them that it also has.
- *frame*: a map of the first cell, which has what all tiles share.
- *stamp*: a digest of all that a map depends on.
- *node*: a connected component of the cells of a tile with its halo.
"""
