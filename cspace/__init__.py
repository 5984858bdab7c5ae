"""Certified configuration-space maps for motion planning.

The public names are listed in ``__init__.pyi``. Each is imported at its first use, so that
importing the package costs next to nothing.
"""

import lazy_loader

try:
    __getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
except ValueError as error:
    raise ImportError(f"{__file__} is in an archive; cspace runs only from a folder") from error

__version__ = "0.2.0"
