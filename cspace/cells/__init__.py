"""Passes over all cells of a map."""
