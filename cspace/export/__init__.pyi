# The public names. Each is imported at its first use.

from ._writers import EXPORT_FORMATS as EXPORT_FORMATS
from ._writers import export as export
from ._writers import to_xarray as to_xarray
