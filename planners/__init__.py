"""Planning with OMPL on certified configuration-space maps (experimental).

Rooms: ``_edges`` (motions of drives), ``_motion`` (times), ``_searches`` (our own searches) and
``_ompl`` (OMPL's). Words that the modules of this package share:

- *room*: a region that counts as a start or goal.
- *route*: a start with its goals.
"""

from importlib import import_module
from typing import Any

from cspace.errors import MissingPackageError
from cspace.inside import attach_stub

_import_name, __dir__, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public name; most need OMPL."""
    try:
        return _import_name(name)
    except ImportError:
        _check_ompl()
        raise


def _check_ompl() -> None:
    """Raise MissingPackageError if OMPL cannot be imported."""
    try:
        import_module("ompl.geometric")
    except ImportError as error:
        raise MissingPackageError(
            "planners",
            f"needs OMPL, which cannot be imported ({error})",
            "it has wheels for Python 3.11 to 3.13 on Linux and macOS; cspace works without it",
        ) from error
