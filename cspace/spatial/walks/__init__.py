"""Walks along straight edges in space."""
