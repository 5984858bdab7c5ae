"""Queries of a map: points, edges, overlaps, and sets of configurations, over one record."""
