"""Maps larger than memory, tile by tile."""
