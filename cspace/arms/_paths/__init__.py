"""Paths of an arm, whose motions are proven: by a search with two trees, or along lines of a frame.

They take an arm among obstacles, and give rows of joints.
"""
