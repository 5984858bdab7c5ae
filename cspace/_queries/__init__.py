"""Queries of a map over one record."""
