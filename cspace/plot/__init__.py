"""Pictures of maps and arms, and animations of robots. Nothing here opens a window."""

from cspace.plot._animation import animate
from cspace.plot._picture import PICTURE_SUFFIXES, plot, save_figure, save_plot

__all__ = ["PICTURE_SUFFIXES", "animate", "plot", "save_figure", "save_plot"]
