# Names of planners for packages that stand beside them. Each is imported at its first use.

from ._motion.trajectory import bound_rates as bound_rates
from ._motion.ways import PathPieces as PathPieces
from ._motion.ways import cut_way as cut_way
from ._motion.ways import drive_around as drive_around
from ._motion.ways import wait_first as wait_first
