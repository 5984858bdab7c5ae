"""Pictures of maps and arms, and animations of robots. Nothing here opens a window."""

from cspace.plot.animation import animate
from cspace.plot.picture import PICTURE_SUFFIXES as PICTURE_SUFFIXES
from cspace.plot.picture import plot, save_plot

__all__ = ["animate", "plot", "save_plot"]
