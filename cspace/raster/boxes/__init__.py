"""Rasters of rounded boxes: balls, points, boxes and voxels, in R^3 (balls and points in the plane too)."""

from cspace.raster.boxes.balls import rasterize_balls as rasterize_balls
from cspace.raster.boxes.balls import solid_ball_rasters as solid_ball_rasters
from cspace.raster.boxes.cuboid import box_rasters as box_rasters
from cspace.raster.boxes.voxels import voxel_rasters as voxel_rasters
