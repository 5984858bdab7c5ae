"""Rasters: shapes to cells, outer and inner, safe against rounding."""

from cspace.raster.obstacles import cells_touched_and_inside as cells_touched_and_inside
from cspace.raster.obstacles import rasterize_obstacles as rasterize_obstacles
from cspace.raster.raster import Raster as Raster
from cspace.raster.robots import ball_rasters as ball_rasters
from cspace.raster.robots import outline_rasters as outline_rasters
