"""Look-ups in maps of robots that turn."""
