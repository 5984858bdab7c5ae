"""Shortest curves of cars."""
