"""Pictures of maps, and animations of a robot on its way in the plane; nothing here opens a window."""

from cspace.plot.animation import animate as animate
from cspace.plot.picture import SUFFIXES as SUFFIXES
from cspace.plot.picture import plot as plot
from cspace.plot.picture import save_plot as save_plot
from cspace.plot.thumbnails import as_html as as_html
from cspace.plot.thumbnails import thumbnail as thumbnail
