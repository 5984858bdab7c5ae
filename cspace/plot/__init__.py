"""Pictures of maps and arms, and animations of a robot on its way; nothing here opens a window."""

from cspace.plot.animation import animate
from cspace.plot.picture import SUFFIXES as SUFFIXES
from cspace.plot.picture import as_html as as_html
from cspace.plot.picture import plot, save_plot, thumbnail

__all__ = ["animate", "plot", "save_plot", "thumbnail"]
