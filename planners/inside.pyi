# Names of planners for packages that stand beside them. Each is imported at its first use.

from ._search import find_chain as find_chain
from ._trajectory import bound_rates as bound_rates
