# Names of planners for packages that stand beside them. Each is imported at its first use.

from ._motion.trajectory import bound_rates as bound_rates
