"""Rasters of meshes: every cell that a triangle touches, and the cells and lattice points inside."""

from cspace.raster.solids.meshes import mesh_rasters as mesh_rasters
from cspace.raster.solids.meshes import rasterize_mesh as rasterize_mesh
