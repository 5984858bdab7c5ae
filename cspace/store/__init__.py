"""Saved maps: whole ones, and those in tiles."""
