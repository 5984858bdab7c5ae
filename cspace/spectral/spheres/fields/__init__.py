"""What is known of a shape to be decomposed: its signed distance, its cells, its size."""

from cspace.spectral.spheres.fields.border import Border as Border
from cspace.spectral.spheres.fields.border import in_space as in_space
from cspace.spectral.spheres.fields.lattice import Lattice as Lattice
from cspace.spectral.spheres.fields.regions import Region as Region
from cspace.spectral.spheres.fields.regions import region_of as region_of
