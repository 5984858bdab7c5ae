"""Maps larger than memory: built, stored and queried tile by tile, on one machine or a cluster."""
