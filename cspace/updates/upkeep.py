"""What hangs on the state of a map: brought up to date where it was asked for before, or dropped.

The one place beside the map's own classes that knows what they keep. The locks of the map's store and of that of its
look-ups are held by the caller, so that nothing is being made from what changes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.clearance import ClearanceField, renew_clearance
from cspace.coarse import renew_coarse
from cspace.updates import _kernels

if TYPE_CHECKING:
    from cspace.connectivity import Components
    from cspace.space import CSpace

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]


def keep_sums(space: CSpace, box: Ints, outer: Bytes, inner: Bytes) -> None:
    """Running counts of obstacle cells, from which overlaps are summed."""
    for key, cells in (("outer sums", outer), ("inner sums", inner)):
        sums = space._once.made(key)
        if sums is not None:
            _kernels.renew_sums(sums.reshape(*cells.shape[:2], -1), cells, box)


def keep_sets(space: CSpace, told: Ints) -> None:
    """Components, and the lists of FREE cells."""
    space._once.drop("free cells")
    components: Components | None = space._once.made("components")
    if components is not None:
        components.renew(told[:, _kernels.CHANGED : _kernels.CHANGED + 6])


def keep_exact(space: CSpace) -> None:
    """What asks the geometry itself: from now on, the cells."""
    exact = space._once.made("exact")
    if exact is not None:
        exact.follow(space.workspace, space._outsides)


def keep_lookups(space: CSpace, states: Bytes, told: Ints, free: Ints, moved: bool) -> None:
    """Tables and distances of the compiled look-ups, and what they know of the outside, which has ``moved`` or not.

    ``free`` is the number of FREE cells of each slice.
    """
    lookups: Any = space._once.made("look-ups")
    if lookups is None:
        return
    tables = lookups._once.made("tables")
    rows = lookups._once.made("rows")
    for table, cells, row in zip(tables or [rows] * (rows is not None), states, told, strict=False):
        _renew_table(table, cells[0], row[_kernels.CHANGED : _kernels.CHANGED + 6])
    coarse = lookups._once.made("coarse")
    if coarse is not None:
        renew_coarse(states, coarse, told[:, _kernels.CHANGED : _kernels.CHANGED + 6])
    if moved and space.rotations is not None:
        lookups._map[4][...] = [outside.box for outside in space._outsides]
    if lookups._once.made("clearance") is not None:
        _renew_distances(space, lookups, states, told, free < states[0].size, moved)


def _renew_table(rows: list[bytes], cells: Bytes, box: Ints) -> None:
    """The rows of a table of :func:`cspace.plane.table_of` that a box of changed cells touches."""
    first, last = int(box[1]), int(box[4])
    for x in range(first, last + 1):
        row = cells[x].tobytes()
        rows[x] = row + row[-1:]
    if first <= last == len(cells) - 1:
        rows[last + 1] = rows[last]


def _renew_distances(
    space: CSpace, lookups: Any, states: Bytes, told: Ints, some: NDArray[np.bool_], moved: bool
) -> None:
    kept = lookups._once.made("clearance")
    freed = told[:, _kernels.FREED : _kernels.FREED + 6]
    if space.rotations is None:
        renew_clearance(states, kept.squares.reshape(states.shape), freed)
        stale = moved or bool(some[0]) != kept.some
        if stale:
            lookups._once.put("clearance", ClearanceField(kept.squares, bool(some[0])))
    else:
        squares, known = kept[:2]
        renew_clearance(states, squares.reshape(states.shape), freed)
        known[...] = some
        stale = moved
        if stale:
            walls = [outside.walls(space.grid.shape) for outside in space._outsides]
            ends = np.cumsum([len(part) for part in walls])
            lookups._once.put("clearance", (squares, known, np.concatenate(walls), ends))
    if stale:
        lookups._once.drop("clearance of")
        space._aim_clearance()
