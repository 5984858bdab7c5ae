"""What is known of a shape to be decomposed: its signed distance, its cells, its size."""

from cspace.spheres.fields.border import Border as Border
from cspace.spheres.fields.border import in_space as in_space
from cspace.spheres.fields.lattice import Lattice as Lattice
from cspace.spheres.fields.regions import Region as Region
from cspace.spheres.fields.regions import region_of as region_of
