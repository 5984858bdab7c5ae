"""Maps that do not fit into memory: built, stored and looked up tile by tile, on one machine or on many."""
