"""Planning with OMPL on certified configuration-space maps (experimental).

Rooms: ``_edges`` (motions of drives), ``_motion`` (times), ``_searches`` (our own searches) and
``_ompl`` (OMPL's). Words that the modules of this package share:

- *room*: a region that counts as a start or goal.
- *route*: a start with its goals.
- *stage*: the start, a place on the way, or the goal.
- *leg*: the part of a plan from one stage to the next (in ``_motion``, between minima of speed).
"""

from typing import Any

from cspace.inside import attach_stub

_import_name, __dir__, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Import a public name; most need OMPL."""
    try:
        return _import_name(name)
    except ImportError:
        from planners._catalogue import check_ompl

        check_ompl()
        raise
