"""Paths through cubes of FREE cells: the map's own search, without a sampling planner."""
