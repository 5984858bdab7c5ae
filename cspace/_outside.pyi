# Functions of wings that the core calls: methods of its classes, and readers.

from ._tiles.build import build_tiles as build_tiles
from ._tiles.tiled_space import open_tiles as open_tiles
from .arms._reading.link_shapes import read_obstacles as read_obstacles
from .arms._reading.link_shapes import read_rigid_links as read_rigid_links
from .export._messages import to_costmap as to_costmap
from .export._messages import to_occupancy_grid as to_occupancy_grid
from .export._writers import export as export
from .export._writers import to_xarray as to_xarray
from .plot._artists import show_png as show_png
from .plot._picture import plot as plot
from .reasons._explain import explain as explain
from .reasons._removals import removals as removals
from .regions._cover import free_regions as free_regions
from .regions._free_region import free_region as free_region
from .view._viewer import view as view
