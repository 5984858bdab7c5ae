"""Walks along edges on which a robot moves and turns."""
