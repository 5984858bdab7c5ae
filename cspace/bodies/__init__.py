"""Bodies: what a robot is made of, by kind; each knows its rasters, its bounds and how to be drawn."""

from cspace.bodies.body import Body as Body
from cspace.bodies.flat import Regions as Regions
from cspace.bodies.round import Balls as Balls
from cspace.bodies.solid import Box as Box
from cspace.bodies.solid import Solid as Solid
from cspace.bodies.solid import Voxels as Voxels
