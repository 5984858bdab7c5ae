"""Planning with OMPL on certified configuration-space maps.

OMPL's objects must be gone before the interpreter ends, or its bindings report leaks: create them
inside functions.
"""

from importlib import import_module

import lazy_loader

from cspace.errors import MissingPackageError

try:
    import_module("ompl.geometric")
except ImportError as error:
    raise MissingPackageError(
        "planners",
        f"needs OMPL, which cannot be imported ({error})",
        "it has wheels for Python 3.11 to 3.13 on Linux and macOS; cspace works without it",
    ) from error

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
