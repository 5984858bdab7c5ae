"""Pictures of maps and arms, and animations of a robot on its way; nothing here opens a window."""

from cspace.plot.animation import animate
from cspace.plot.picture import SUFFIXES, as_html, plot, save_plot, thumbnail

__all__ = ["SUFFIXES", "animate", "as_html", "plot", "save_plot", "thumbnail"]
