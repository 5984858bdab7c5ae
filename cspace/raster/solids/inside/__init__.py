"""Which points lie inside the bodies of a mesh."""

from cspace.raster.solids.inside.bodies import Bodies as Bodies
from cspace.raster.solids.inside.bodies import Body as Body
from cspace.raster.solids.inside.bodies import find_bodies as find_bodies
from cspace.raster.solids.inside.bodies import merged as merged
from cspace.raster.solids.inside.tester import AMBIGUOUS as AMBIGUOUS
from cspace.raster.solids.inside.tester import HOLLOW as HOLLOW
from cspace.raster.solids.inside.tester import INSIDE as INSIDE
from cspace.raster.solids.inside.tester import OUTSIDE as OUTSIDE
from cspace.raster.solids.inside.tester import InsideTester as InsideTester
