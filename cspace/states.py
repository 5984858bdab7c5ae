"""The three answers that a cell of a map can give."""

from typing import Final

FREE: Final = 0
"""Every configuration of the cell is proven collision-free."""

MIXED: Final = 1
"""Not decided at this resolution."""

BLOCKED: Final = 2
"""Every configuration of the cell is proven to be in collision."""

NAMES: Final = ("free", "mixed", "blocked")
"""Name of each state, by its value."""

FIELDS: Final = ("penetration", "penetration_x", "penetration_y", "penetration_z")
"""What a map may carry besides: the overlap of descriptors, and its derivatives along the axes."""
