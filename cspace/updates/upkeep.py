"""Distances for clearance, brought up to date after a change of a map."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cspace.clearance import ClearanceField, renew_clearance
from cspace.map.kept import Change

if TYPE_CHECKING:
    from cspace.space import CSpace


def keep_distances(space: CSpace, change: Change) -> None:
    lookups = space._distances.made
    if lookups is None:
        return
    if change.exterior and space.rotations is not None:
        lookups._map[4][...] = space._exterior.boxes
    kept = lookups._once.made("clearance")
    if kept is None:
        return
    states = space._states.reshape(len(space._states), *(1,) * (4 - space._states.ndim), *space.grid.shape)
    some = change.free < states[0].size
    if space.rotations is None:
        renew_clearance(states, kept.squares.reshape(states.shape), change.freed)
        stale = change.exterior or bool(some[0]) != kept.some
        if stale:
            lookups._once.put("clearance", ClearanceField(kept.squares, bool(some[0])))
    else:
        squares, known = kept[:2]
        renew_clearance(states, squares.reshape(states.shape), change.freed)
        known[...] = some
        stale = change.exterior
        if stale:
            walls = [outside.walls(space.grid.shape) for outside in space._outsides]
            ends = np.cumsum([len(part) for part in walls])
            lookups._once.put("clearance", (squares, known, np.concatenate(walls), ends))
    if stale:
        lookups._once.drop("clearance of")
        call = space._clearance_call.made
        if call is not None:
            call[0] = lookups.clearance_checker()
