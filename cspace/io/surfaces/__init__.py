"""Files of triangles and polygons, one reader for each format: all that a file holds, or an error that names it."""
