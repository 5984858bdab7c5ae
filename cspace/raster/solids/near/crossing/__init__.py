"""Which bodies of a mesh cross one another, and which cross themselves."""

from cspace.raster.solids.near.crossing.crossings import Crossings as Crossings
