"""Planning with OMPL on certified configuration-space maps (experimental).

Words that the modules of this package share:

- *segment*: an edge of a path, or a curve in place of a corner.
- *interval*: a part of a segment within which the bounds of its derivatives are constant.
- *phase*: a stretch of time with one acceleration, or with one jerk.
- *leg*: the part of a path between two points where the robot is slowest.
- *ramp*: a change of speed on a leg, whose acceleration rises evenly, stays, and falls evenly.
- *tube*: all configurations within some distances of a motion.
- *chain*: cells of a map, each beside the next, that a search goes through.
- *block*: a cube of cells that a search first takes as one.
- *room*: a region that counts as a start or goal.
- *junction*: the state of a moving robot at which a motion begins.

OMPL's objects must be gone before the interpreter ends, or its bindings report leaks: create them
inside functions.
"""

from importlib import import_module
from typing import Any

from cspace._support import attach_stub
from cspace.errors import MissingPackageError

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
