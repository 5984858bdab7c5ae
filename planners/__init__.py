"""Planning with OMPL on certified configuration-space maps (experimental).

:func:`plan` finds a path on a map of :mod:`cspace` whose every edge is proven free, and returns a
:class:`Plan`; :func:`choices` lists what it can do on a space. :class:`Differential` and
:class:`Car` are drives, :class:`Near` a place with room around it, :class:`Search` a planner with
settings. :meth:`Plan.trajectory` times a path within limits of speed and acceleration.
"""

# Rooms: ``_edges`` (motions of drives), ``_motion`` (times), ``_searches`` (our own searches) and
# ``_ompl`` (OMPL's). Words that the modules of this package share:
#
# - *room*: a region that counts as a start or goal.
# - *route*: a start with its goals.
# - *stage*: the start, a place on the way, or the goal.
# - *leg*: the part of a plan from one stage to the next (in ``_motion``, between minima of speed).

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
