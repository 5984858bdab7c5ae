"""How large the blocks of a coarse map are; a power of two, so that a cell's block is a shift away."""

from __future__ import annotations

from typing import Final

SHIFT: Final = 3

SIDE: Final = 1 << SHIFT
"""Cells along each side of a block."""
