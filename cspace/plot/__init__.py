"""Pictures of maps and arms, and animations of robots. Nothing here opens a window."""

from cspace.plot._animation import animate
from cspace.plot._picture import plot, save_plot

__all__ = ["animate", "plot", "save_plot"]
