# The public names. Each is imported at its first use.

from ._maps import export as export
from ._maps import to_xarray as to_xarray
