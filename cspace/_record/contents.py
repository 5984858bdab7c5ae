"""Contents of a map, for builds, files and pickles."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace._engines.slices import RasterPair, list_slice_cells, slice_rasters
from cspace._grid import SLACK, Grid, check_reach
from cspace._record.exterior import OUTSIDES, UNKNOWN, Exterior
from cspace._rotations import RotationCell, Rotations
from cspace._shapes.layers import Heights
from cspace._support.arrays import MIXED, Bools, Ints, States
from cspace._support.check import check_number, check_word
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace._robot import Robot
    from cspace._workspace import Workspace


@dataclass(frozen=True, slots=True, eq=False)
class Contents:
    """All data of a map that queries derive from.

    Attributes
    ----------
    workspace : Workspace
    robot : Robot
    rotations : Rotations
    slice_of : ndarray of int64, shape (rotations,)
        The slice of each rotation cell.
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
        FREE, MIXED or BLOCKED for each cell of positions of the reference point. Taken over, not
        copied, unless it is read-only: updates write into it.
    outside : {"blocked", "free", "unknown"}
        State of the world outside the grid; "unknown" for a part of a larger map.
    margin : float
        Growth of the robot for FREE, metres.
    overlap_counts : ndarray of int32, the shape of states, or None
        Overlap of each cell; taken over like ``states``.
    exterior : Exterior or None
        States outside the grid; if None, computed from the robot's rasters when needed.
    proves_blocked : bool
        True if updates prove BLOCKED, as the build did.
    floor : float or None
        Height of the reference point of a robot in space that drives on a floor, metres. The
        workspace is then in space, and grid and states in the plane.
    grid : Grid
        Grid of positions: the workspace's, with a floor without its heights.

    Raises InputError if an array has another shape or type than stated, or ``outside`` is another
    word.
    """

    workspace: Workspace
    robot: Robot
    rotations: Rotations
    slice_of: Ints
    states: States
    outside: str = "blocked"
    margin: float = 0.0
    overlap_counts: NDArray[np.int32] | None = None
    exterior: Exterior | None = None
    proves_blocked: bool = True
    floor: float | None = None
    grid: Grid = field(init=False)

    def __post_init__(self) -> None:
        """Check the arrays, and derive the grid."""
        grid = self.workspace.grid
        if self.floor is not None:
            check_floor(self.floor, grid, self.robot, self.outside)
            grid = Grid(grid.lower[:2], grid.spacing, grid.shape[:2], frame_id=grid.frame_id)
        object.__setattr__(self, "grid", grid)
        n_slices = int(self.slice_of.max()) + 1
        shape = (n_slices, *self.grid.shape)
        states = _check_array("states", self.states, shape, np.uint8)
        object.__setattr__(self, "states", states)
        if self.overlap_counts is not None:
            counts = _check_array("overlap_counts", self.overlap_counts, shape, np.int32)
            object.__setattr__(self, "overlap_counts", counts)
        if self.outside != UNKNOWN:
            check_word(self.outside, "outside", OUTSIDES)

    @classmethod
    def undecided(
        cls, workspace: Workspace, robot: Robot, rotations: Rotations, **options: Any
    ) -> Contents:
        """Return the contents of a map whose cells are all MIXED."""
        slice_of = rotations._assign_slices(robot.shape)
        shape = (int(slice_of.max()) + 1, *workspace.grid.shape)
        states = np.full(shape, MIXED, dtype=np.uint8)
        return cls(workspace, robot, rotations, slice_of, states, **options)

    @property
    def ground(self) -> Workspace:
        """The workspace on the map's grid; with a floor, seen from above at the robot's heights."""
        scene = self.workspace
        heights = Heights.of(scene.grid, self.floor)
        if heights is None:
            return scene
        from cspace._workspace import Workspace

        layers = heights.find_layers(self.robot.shape, scene.grid.spacing)

        def project(cells: Bools) -> Bools:
            """Return cells seen from above."""
            return np.asarray(cells[:, :, layers].any(axis=2))

        outer, inner = project(scene.outer), project(scene.inner)
        unknown = None if scene.unknown is None else project(scene.unknown)
        return Workspace(self.grid, outer, inner, source=scene.source, unknown=unknown)

    @property
    def slice_cells(self) -> list[RotationCell]:
        """Rotation cell of each slice, as shapes take it."""
        return list_slice_cells(self.robot, self.rotations)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of a configuration."""
        return (*self.grid.axes, *self.rotations.names)

    def stack_shape(self, n: int) -> tuple[int, ...]:
        """Return the shape of n slices, or of one without rotations."""
        return (*self.rotations._leading_axes(n), *self.grid.shape)

    def copy(self) -> Contents:
        """Return a copy that shares only constant arrays."""
        from cspace._workspace import copy_workspace

        counts = None if self.overlap_counts is None else self.overlap_counts.copy()
        exterior = None if self.exterior is None else Exterior(self.exterior.table.copy())
        return replace(
            self,
            workspace=copy_workspace(self.workspace),
            states=self.states.copy(),
            overlap_counts=counts,
            exterior=exterior,
        )


def rasters_of(contents: Contents, margin: float) -> list[RasterPair]:
    """Return the outer and inner raster of each slice, for the robot grown by a margin, metres."""
    heights = Heights.of(contents.workspace.grid, contents.floor)
    return slice_rasters(contents.robot, contents.grid.spacing, margin, contents.rotations, heights)


def check_floor(floor: float, grid: Grid, robot: Robot, outside: str) -> float:
    """Return the height of a floor, or raise InputError unless the robot keeps to the scene.

    ``grid`` is that of the scene. Nothing is known of obstacles at other heights, unless the
    ``outside`` is free.
    """
    if grid.dim != 3:
        rule = "a robot on a floor needs a workspace in space"
        raise InputError("floor", "is given for a plane workspace", rule)
    if robot.dim != 3:
        raise InputError("floor", "is given for a plane robot", "a robot in space has heights")
    height = check_number(floor, "floor")
    check_reach(abs(height) / grid.spacing, "floor", "the origin")
    if outside != "free":
        check_heights("floor", f"is {height:g} m, so", height, grid, robot)
    return height


def check_heights(name: str, given: str, floor: float, grid: Grid, robot: Robot) -> None:
    """Raise InputError for an argument if a robot on a floor leaves the heights of a scene.

    ``given`` begins the problem, before the heights of the robot.
    """
    lowest, highest = (floor + float(corner[2]) for corner in robot.shape.outer.bounds)
    bottom, top = grid.lower[2], grid.upper[2]
    room = SLACK * grid.spacing
    if not (bottom - room <= lowest and highest <= top + room):
        problem = f"{given} the robot reaches from {lowest:g} m to {highest:g} m"
        rule = f"the workspace has only heights from {bottom:g} m to {top:g} m"
        raise InputError(name, problem, rule)


def _check_array(
    name: str, array: NDArray[Any], shape: tuple[int, ...], dtype: type[np.generic]
) -> NDArray[Any]:
    """Return a contiguous, writeable array, or raise InputError."""
    if array.shape != shape or array.dtype != dtype:
        problem = f"has shape {array.shape} and type {array.dtype}"
        rule = f"it must have the map's shape {shape} and type {np.dtype(dtype)}"
        raise InputError(name, problem, rule)
    contiguous = np.ascontiguousarray(array)
    return contiguous if contiguous.flags.writeable else contiguous.copy()
