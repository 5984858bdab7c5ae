"""Stack: what a map holds, slice by slice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.once import Once
from cspace.outside import Outside
from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.slices import slice_of_rotation, slice_rasters
from cspace.states import BLOCKED, FIELDS, FREE
from cspace.workspace import Workspace


class Stack:
    """The state of every cell of configurations, and the robot and the workspace that it belongs to.

    Parameters
    ----------
    workspace : Workspace
    robot : Robot
    state : ndarray of uint8, shape (nx, ny), (nx, ny, nz) or (slices, nx, ny)
        FREE, MIXED or BLOCKED, of each cell of positions of the robot's reference point; with rotations, of each slice.
        It is taken over, not copied, unless it is read-only: updates write into it.
    outside : {"blocked", "free"}
    margin : float
        Metres by which the robot was grown for FREE.
    precision : {"integer", "float32", "float64"}
        Arithmetic of the engine: whole numbers, or transforms in floating point, rounded to them.
    overlaps : ndarray of int32, the shape of state, optional
        Overlap of each cell.
    rotations : Rotations, optional
        Rotation cells of a robot that turns.
    rasters : sequence of (outer, inner) Raster, optional
        The robot's, for each slice; made again if left out.
    fields : mapping of str to ndarray of float64, the shape of state, optional
        What :class:`cspace.spectral.OverlapField` holds; all of it, or nothing.
    trusted : bool
        Whether the states are known to be those three, as those of a build are, and not looked at.
    tells_blocked : bool, optional
        Whether BLOCKED is told from MIXED; None where that is not known, as of a map from a file.

    Attributes
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny) or (1, nx, ny, nz)
        The slices, as they are stored: one where the robot only translates.
    slice_of : ndarray of int64, shape (rotations,)
        Which slice each rotation cell has; turns that map the robot to itself share theirs.
    fields : dict of str to ndarray of float64
        The overlap field that the map carries, if any: :attr:`cspace.CSpace.overlap_field`.
    """

    def __init__(
        self,
        workspace: Workspace,
        robot: Robot,
        state: NDArray[np.uint8],
        *,
        outside: str,
        margin: float,
        precision: str,
        overlaps: NDArray[np.int32] | None = None,
        rotations: Rotations | None = None,
        rasters: Sequence[tuple[Raster, Raster]] | None = None,
        fields: Mapping[str, NDArray[np.float64]] | None = None,
        trusted: bool = False,
        tells_blocked: bool | None = None,
    ) -> None:
        if rotations is not None and workspace.grid.dim != 2:
            raise InputError("rotations are given for a robot in space; it only translates so far; leave them out")
        self.slice_of = slice_of_rotation(robot, rotations)
        shape = workspace.grid.shape if rotations is None else (int(self.slice_of.max()) + 1, *workspace.grid.shape)
        for name, array, kind in (("state", state, np.uint8), ("overlaps", overlaps, np.int32)):
            if array is not None and (array.shape != shape or array.dtype != kind):
                raise InputError(
                    f"{name} has shape {array.shape} and type {array.dtype}; it must have the map's shape "
                    f"{shape} and type {np.dtype(kind)}; use cspace.build"
                )
        if outside not in ("blocked", "free"):
            raise InputError(f"outside is {outside!r}; it must be 'blocked' or 'free'")
        if not trusted and state.size and state.max() > BLOCKED:
            raise InputError(f"state holds {state.max()}; it must be FREE, MIXED or BLOCKED, 0 to 2; use cspace.build")
        self.workspace = replace(workspace, live=False) if workspace.live else workspace
        self.robot = robot
        self.outside = outside
        self.margin = margin
        self.precision = precision
        self.tells_blocked = tells_blocked
        self.rotations = rotations
        # Updates write through views of their own; all others see read-only ones.
        states = writable(state)
        self._states = states.view().reshape(-1, *workspace.grid.shape)
        self.stack = read_only(states).reshape(-1, *workspace.grid.shape)
        self._counts: NDArray[np.int32] | None = None
        self.overlaps: NDArray[np.int32] | None = None
        if overlaps is not None:
            counts = writable(overlaps)
            self._counts = counts.view().reshape(self.stack.shape)
            self.overlaps = read_only(counts)
        self.fields = checked_fields(fields, workspace.grid.dim, shape) if fields else {}
        self._once = Once()
        if rasters is not None:
            self._once("rasters", lambda: list(rasters))

    @property
    def grid(self) -> Grid:
        """Cells of positions of the robot's reference point; the workspace's grid."""
        return self.workspace.grid

    @property
    def dof(self) -> int:
        """Numbers in a configuration: 2 in the plane, 3 in space, 3 for a robot that turns in the plane."""
        return self.grid.dim if self.rotations is None else 3

    @property
    def state(self) -> NDArray[np.uint8]:
        """State of each cell, shape (nx, ny), (nx, ny, nz) or (rotations, nx, ny).

        Read-only. A new array at each call where slices are shared; :attr:`stack` and :attr:`slice_of` cost nothing.
        """
        if self.rotations is None:
            only: NDArray[np.uint8] = self.stack[0]
            return only
        shared = len(self.stack) < len(self.slice_of)
        every: NDArray[np.uint8] = read_only(self.stack[self.slice_of]) if shared else self.stack
        return every

    def slice_at(self, yaw: float = 0.0) -> NDArray[np.uint8]:
        """State of each cell in the rotation cell of a yaw (radians), shape (nx, ny); all of a robot in space."""
        cell = 0 if self.rotations is None else int(self.rotations.cell_of(yaw))
        part: NDArray[np.uint8] = self.stack[self.slice_of[cell]]
        return part

    def count(self) -> tuple[int, int, int]:
        """Number of FREE, MIXED and BLOCKED cells, over all rotation cells."""
        shares = np.bincount(self.slice_of, minlength=len(self.stack))
        each = np.array([np.bincount(part.ravel(), minlength=3) for part in self.stack])
        free, mixed, blocked = (shares @ each).tolist()
        return free, mixed, blocked

    def __repr__(self) -> str:
        free, mixed, blocked = self.count()
        cells = " x ".join(map(str, self.grid.shape))
        turns = "" if self.rotations is None else f" x {self.rotations.count} rotations"
        return (
            f"CSpace({cells} cells of {self.grid.spacing:g} m{turns}, {self.robot.name}: {free=}, {mixed=}, {blocked=})"
        )

    @property
    def _rasters(self) -> list[tuple[Raster, Raster]]:
        return self._once("rasters", lambda: slice_rasters(self.robot, self.grid.spacing, self.margin, self.rotations))

    @property
    def _outsides(self) -> list[Outside]:
        outer = self.workspace.outer
        return self._once("outsides", lambda: [Outside.of(outer, *pair, self.outside) for pair in self._rasters])

    @property
    def _free_cells(self) -> list[NDArray[np.unsignedinteger[Any]]]:
        """Flat indices of the FREE cells of each slice."""
        kind = np.uint32 if self.grid.size < 2**32 else np.uint64
        return self._once("free cells", lambda: [np.flatnonzero(part == FREE).astype(kind) for part in self.stack])

    def _rim_is_open(self) -> NDArray[np.bool_]:
        """Whether some configuration outside the grid is not BLOCKED, for each slice."""
        return np.array([not outside.is_all_blocked(self.grid.shape) for outside in self._outsides])

    def _slices_of(self, q: ArrayLike) -> NDArray[np.int64]:
        """Slice of each of a batch of configurations."""
        if self.rotations is None:
            return np.zeros(np.shape(q)[:-1], dtype=np.int64)
        part: NDArray[np.int64] = self.slice_of[self.rotations.cell_of(np.asarray(q, dtype=np.float64)[..., 2])]
        return part

    def _cells_of(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Cells ``(rotation, x, y)`` or ``(0, x, y, z)`` of configurations, in the grid or not."""
        cells = self.grid.cell_of(points[..., : self.grid.dim])
        turn = (
            np.zeros(points.shape[:-1], np.int64) if self.rotations is None else self.rotations.cell_of(points[..., 2])
        )
        return np.concatenate([turn[..., None], cells], axis=-1)


def writable(array: NDArray[Any]) -> NDArray[Any]:
    """The array in one piece, and to be written; a copy only where it is not."""
    array = np.ascontiguousarray(array)
    return array if array.flags.writeable else array.copy()


def checked_fields(
    fields: Mapping[str, NDArray[np.float64]], dim: int, shape: tuple[int, ...]
) -> dict[str, NDArray[np.float64]]:
    """The arrays of an overlap field, in the order of :data:`cspace.states.FIELDS`, not to be written.

    Raises
    ------
    InputError
        If one is missing or there are others, or one has another shape or type, or holds what is not finite.
    """
    names = FIELDS[: 1 + dim]
    if set(fields) != set(names):
        raise InputError(
            f"the fields are {', '.join(fields) or 'none'}; of a map of {dim} axes they must be {', '.join(names)}; "
            "use OverlapField.of, or CSpace.with_overlap_field"
        )
    for name in names:
        array = fields[name]
        if array.shape != shape or array.dtype != np.float64:
            raise InputError(
                f"{name} has shape {array.shape} and type {array.dtype}; it must have the map's shape {shape} and type "
                "float64; use OverlapField.of, or CSpace.with_overlap_field"
            )
        finite(array, name)
    return {name: read_only(fields[name]) for name in names}


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The array in one piece, and not to be written."""
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
