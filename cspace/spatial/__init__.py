"""Look-ups in maps of robots that translate in space: configurations ``(x, y, z)``."""
