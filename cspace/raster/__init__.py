"""Rasters: what the shapes share to turn themselves into cells, outer and inner, safe against rounding."""

from cspace.raster.raster import Raster as Raster
