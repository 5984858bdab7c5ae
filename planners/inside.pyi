# Names of planners for packages that stand beside them. Each is imported at its first use.

from ._motion.trajectory import bound_rates as bound_rates
from ._searches.chains import find_chain as find_chain
