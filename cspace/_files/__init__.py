"""Readers of files into arrays, one format per module, without grids or maps."""
