"""How well balls describe a shape: areas and volumes of unions, and one-sided Hausdorff distances."""

from cspace.spectral.spheres.measures.hausdorff import balls_to_shape as balls_to_shape
from cspace.spectral.spheres.measures.hausdorff import shape_to_balls as shape_to_balls
from cspace.spectral.spheres.measures.unions import measure_of_balls as measure_of_balls
