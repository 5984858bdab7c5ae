"""The fewest named obstacles whose removal gives a path.

The problem is minimum constraint removal (K. Hauser, "The minimum constraint removal problem with
three robotics applications", 2014). Cells that the same named obstacles make not FREE, and that
share sides, are one region. Sets of names are tried by size: a set gives a path if regions without
other names join start and goal.
"""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from cspace import FREE
from cspace.errors import InputError
from cspace.inside import Ints, contents_of, find_overlaps, rasters_of
from cspace.reasons._margins import copy_with_ends, find_cells, states_of_slices

if TYPE_CHECKING:
    from cspace import CSpace

NEVER: Final = -1
"""Mask of cells that stay not FREE if all named obstacles are removed."""


class Removals(list[str]):
    """Named obstacles whose removal gives a path.

    Parameters
    ----------
    names : sequence of str
    at_least : int
        Lower bound: removing fewer obstacles gives no path in FREE cells.
    """

    def __init__(self, names: Sequence[str], at_least: int) -> None:
        """Store the names and the lower bound."""
        super().__init__(names)
        self.at_least = at_least

    @property
    def is_fewest(self) -> bool:
        """True if no smaller set gives a path in FREE cells."""
        return len(self) == self.at_least


class Regions(NamedTuple):
    """Connected regions of cells that the same named obstacles make not FREE.

    Attributes
    ----------
    numbers : ndarray of int64, shape (rotations, x, y) or (rotations, x, y, z)
        Region of each cell.
    masks : ndarray of int64, shape (regions,)
        A bit for each named obstacle that the robot may touch in the region, or ``NEVER``.
    pairs : ndarray of int64, shape (n, 2)
        Regions that share the side of a cell, or a cell at neighbouring rotations.
    """

    numbers: Ints
    masks: Ints
    pairs: Ints

    def are_connected(self, start: int, goal: int, removed: int) -> bool:
        """Return True if two regions are connected once obstacles are removed.

        ``removed`` is their mask.
        """
        is_free = (self.masks != NEVER) & ((self.masks & ~removed) == 0)
        if not (is_free[start] and is_free[goal]):
            return False
        first, second = self.pairs[is_free[self.pairs].all(axis=1)].T
        n = len(self.masks)
        graph = sparse.coo_array((np.ones(len(first)), (first, second)), (n, n))
        _, components = csgraph.connected_components(graph, directed=False)
        return bool(components[start] == components[goal])


def removals(space: CSpace, start: ArrayLike, goal: ArrayLike) -> Removals | None:
    """Find fewest named obstacles whose removal gives a path.

    See :attr:`cspace.CSpace.obstacles`. The map itself does not change.

    Parameters
    ----------
    start, goal : array-like, shape (size,)
        Configurations in the grid; metres, and radians.

    Returns
    -------
    cspace.reasons.Removals or None
        A list of names; a map without them proves that a path exists. It is empty if one exists
        already. No fewer obstacles give one, for up to 12 of them; for more, ``at_least`` is a
        lower bound of their number. None if a path is not proven without all of them either.

    Raises
    ------
    InputError
        As :meth:`cspace.CSpace.explain`, and if there are over 62 named obstacles.
    ConfigurationError
        If start or goal lies outside the grid.

    References
    ----------
    K. Hauser, "The minimum constraint removal problem with three robotics applications", 2014.

    Examples
    --------
    >>> import numpy as np, shapely, cspace
    >>> workspace = cspace.Workspace.from_array(np.zeros((40, 20), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.2))
    >>> _ = space.add_obstacle("crate", shapely.box(2.0, 0.0, 2.2, 1.2))
    >>> _ = space.add_obstacle("shelf", shapely.box(2.0, 1.2, 2.2, 2.0))
    >>> space.removals((0.5, 0.5), (3.5, 0.5))
    ['crate']
    """
    space, points = copy_with_ends(space, start, goal)
    names = list(space.obstacles)
    # Maximum number of named obstacles; each is a bit of a mask in 64 bits.
    max_names = 62
    if len(names) > max_names:
        problem = f"has {len(names)} named obstacles"
        raise InputError("space", problem, f"at most {max_names} are tried")
    regions = _find_regions(space, names)
    first, last = regions.numbers[tuple(find_cells(space, points).T)].tolist()
    all_names = 2 ** len(names) - 1  # the mask of all obstacles
    if not regions.are_connected(first, last, all_names):
        return None
    # Try all smaller sets than one that is known to give a path, the smallest first.
    sufficient = _find_sufficient(regions, first, last, len(names))
    n_tried = 0
    for size in range(len(sufficient)):
        for chosen in itertools.combinations(range(len(names)), size):
            n_tried += 1
            if regions.are_connected(first, last, sum(1 << bit for bit in chosen)):
                return Removals([names[bit] for bit in chosen], size)
            # Maximum number of sets of names that are tried, enough for all sets of 12 names.
            if n_tried == 2**12:
                return Removals([names[bit] for bit in sufficient], size)
    return Removals([names[bit] for bit in sufficient], len(sufficient))


def remove_obstacles(space: CSpace, names: Sequence[str]) -> CSpace:
    """Copy a map without some named obstacles."""
    without = copy.copy(space)
    for name in names:
        without.remove_obstacle(name)
    return without


def _find_sufficient(regions: Regions, start: int, goal: int, n_names: int) -> list[int]:
    """Find a minimal set of obstacles whose removal gives a path.

    Obstacles are bit numbers. Each is needed, but a smaller set may exist.
    """
    kept = list(range(n_names))
    for bit in reversed(range(n_names)):
        fewer = [other for other in kept if other != bit]
        if regions.are_connected(start, goal, sum(1 << other for other in fewer)):
            kept = fewer
    return kept


def _find_regions(space: CSpace, names: Sequence[str]) -> Regions:
    """Divide a map into regions that touch the same named obstacles."""
    slice_masks = _compute_masks(space, names)
    masks = slice_masks[space.slice_of]
    numbers = np.empty(masks.shape, dtype=np.int64)
    region_masks: list[int] = []
    for part, out in zip(masks, numbers, strict=True):
        for mask in np.unique(part).tolist():
            members = part == mask
            labels, count = ndimage.label(members)
            out[members] = labels[members] + (len(region_masks) - 1)  # labels begin with 1
            region_masks += [mask] * count
    count = len(region_masks)
    pairs = np.unique(np.concatenate([*_list_neighbors(numbers, space.rotations.neighbors, count)]))
    first_and_second = np.stack(np.divmod(pairs, count), axis=1)
    return Regions(numbers, np.array(region_masks, dtype=np.int64), first_and_second)


def _compute_masks(space: CSpace, names: Sequence[str]) -> Ints:
    """Return a mask of obstacles for each cell, shape (slices, x, ...).

    Bit k is set if the robot may touch the obstacle ``names[k]``; the mask is ``NEVER`` if the cell
    is not FREE without named obstacles either.
    """
    outer_rasters = [outer for outer, _ in rasters_of(contents_of(space), space.margin)]
    masks = np.zeros((len(outer_rasters), *space.grid.shape), dtype=np.int64)
    named = space.obstacles
    for bit, name in enumerate(names):
        outer, _ = named[name].cells(space.workspace.grid)
        hits = find_overlaps(outer, outer_rasters, outside=False, on_floor=space.floor is not None)
        masks[hits] |= 1 << bit
    without = remove_obstacles(space, names)
    masks[states_of_slices(without) != FREE] = NEVER
    return masks


def _list_neighbors(numbers: Ints, neighbors: Ints, count: int) -> Iterator[Ints]:
    """Yield pairs of neighbouring regions of ``count``, each pair as one number.

    Regions are neighbours along an axis, or at neighbouring rotations.
    """
    for axis in range(1, numbers.ndim):
        along = np.moveaxis(numbers, axis, 0)
        yield _distinct_pairs(along[:-1], along[1:], count)
    for rotation, others in enumerate(neighbors.tolist()):
        for other in others:
            if other >= 0:  # -1 fills rows of rotations with fewer neighbours
                yield _distinct_pairs(numbers[rotation], numbers[other], count)


def _distinct_pairs(first: Ints, second: Ints, count: int) -> Ints:
    """Return distinct unequal pairs, each as the smaller times ``count`` plus the larger."""
    differs = first != second
    first, second = first[differs], second[differs]
    # Numbers are made distinct some twenty times faster than rows.
    return np.unique(np.minimum(first, second) * count + np.maximum(first, second))
