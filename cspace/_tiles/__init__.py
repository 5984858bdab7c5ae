"""Maps larger than memory, stored as a folder of tiles (experimental)."""
