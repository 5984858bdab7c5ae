"""The parts of a map: what is kept of it, and what can be asked of it."""
