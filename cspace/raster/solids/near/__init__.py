"""Distances between triangles, and between triangles and boxes."""

from cspace.raster.solids.near.crossing import Crossings as Crossings
from cspace.raster.solids.near.margins import mark_within as mark_within
