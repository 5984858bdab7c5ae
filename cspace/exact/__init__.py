"""Exact answers: the geometry itself is asked where the map cannot decide."""

from typing import Final

ROUNDING: Final = 1e-12
"""Rounding allowance of a distance, relative to the coordinates; thousands of times what is needed."""
