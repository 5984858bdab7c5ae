"""The canvas of a map: its cells, the robot, start and goal."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from cspace._rotations import Rotations
from cspace._support.arrays import Floats
from cspace.plot._artists import (
    CLASSES,
    COLLIDES,
    OBSTACLE,
    OPEN,
    ROBOT_EDGE_COLOR,
    ROBOT_FILL_COLOR,
    UNDECIDED,
)
from cspace.plot._route import Body
from cspace.view._blocks import Cells
from cspace.view._canvas import (
    MARKS,
    STATES,
    Canvas,
    Dial,
    farthest_pair,
    sample_free_configurations,
)
from cspace.view._scene import (
    KINDS,
    SECTION,
    Section,
    Stage,
    lift,
    make_robot_surface,
    to_quaternion,
)

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

ANGLES: Final = ("roll", "pitch", "yaw")
"""Rotations about the fixed axes x, then y, then z."""


class CellsDrawing(NamedTuple):
    """Choices on which the drawing of some cells depends.

    Attributes
    ----------
    cell : int or None
        Rotation cell; None if the drawing shows the workspace.
    cut : float
        Height above which cells are omitted, metres.
    lid : bool
        True if solids are closed at the cut.
    """

    cell: int | None
    cut: float
    lid: bool


class MapCanvas(Canvas):
    """Draw a map with the robot, its path, start and goal.

    Parameters
    ----------
    space : CSpace or TiledCSpace
    server : viser.ViserServer
    points : ndarray of float64, shape (n, size)
        A path; cells above the robot on it are cut off. n is 0 without a path.
    marks : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.

    Attributes
    ----------
    cells : Cells
    kinds : list of str
        Names in :data:`cspace.view._scene.KINDS` that the map can have.
    shown : set of str
        Names of the kinds to draw, and SECTION. :meth:`draw` applies this and the other attributes.
    cut : float
        Height above which cells are omitted, metres.
    """

    def __init__(
        self, space: Any, server: ViserServer, points: Floats, marks: dict[str, Floats]
    ) -> None:
        """Draw the robot, the start and the goal; cells are drawn by :meth:`draw`."""
        canonical = {name: space.rotations._make_canonical(q, name) for name, q in marks.items()}
        self.cells = cells = Cells(space)
        super().__init__(server, space, _choose_endpoints(space, cells.drawn) | canonical)
        grid = cells.drawn.grid
        self.glyph = Body(space.robot, space.rotations)
        self.robot_reach = self.glyph.reach
        self.poses = Poses(space.grid.dim, space.rotations)
        # Sliders have steps of a power of ten, at most a cell.
        self._step = 10.0 ** math.floor(math.log10(grid.spacing))
        longest = grid.spacing * max(grid.shape)
        # Gizmos of tiny robots stay visible.
        self.size = max(self.glyph.size, 0.012 * longest)
        # Walls in the plane are half as high as the robot is long, within 0.1 % and 3 % of the map.
        wall = 0.5 * max(self.glyph.size, 0.002 * longest)
        self.stage = stage = Stage(grid, min(wall, 0.03 * longest))
        self.kinds = [*KINDS]
        workspace = cells.drawn.workspace
        if workspace.unknown is None or not workspace.outer[workspace.unknown].any():
            self.kinds.remove("unknown")
        hidden = {"mixed"} if stage.has_height else {"border", "mixed"}
        self.shown = {*self.kinds, SECTION} - hidden
        self.cut = self._choose_cut(points)
        self._drawn: dict[str, CellsDrawing | None] = {}
        self._drawing = threading.Lock()
        self._surface = make_robot_surface(space.robot, stage.wall)
        self._robot = server.scene.add_frame("/robot", show_axes=False)
        self._add_robot("/robot", ROBOT_FILL_COLOR)
        self._gizmos = {name: self._add_gizmo(name, color) for name, color in MARKS.items()}
        back = np.array([-0.5, -1.0, 0.9] if stage.has_height else [0.0, -0.45, 1.0])
        self._place_camera(stage.lower, stage.upper, back)
        self._describe_panel()

    def _choose_cut(self, points: Floats) -> float:
        """Choose a height above the robot at start, goal and path, metres."""
        stage = self.stage
        highest = float(stage.upper[2])
        if not stage.has_height:
            return highest
        stations = np.concatenate([[*self.endpoints.values()], points])
        upper_corners = self.glyph.extents(stations)[:, 1]
        top = upper_corners[:, 2].max()
        # A whole number of steps of the slider, in the map.
        steps: int = math.ceil(top / self._step - 1e-9)
        lowest = float(stage.lower[2]) + stage.grid.spacing
        return min(max(steps * self._step, lowest), highest)

    def _describe_panel(self) -> None:
        """Set the title, the dials and the legend."""
        space = self._space
        grid = space.grid
        shape = " x ".join(f"{n:,}" for n in grid.shape)
        suffix = f" x {space.rotations}" if space.rotations.names else ""
        self.title = space.robot.name
        self.about = f"{shape} cells of {grid.spacing:g} {grid.unit}{suffix}"
        # Coordinates in the unit of the grid, angles in degrees.
        self.dials = [
            Dial(label, round(low, 9), round(high, 9), self._step)
            for label, low, high in zip(grid.labels, grid.lower, grid.upper, strict=True)
        ]
        for angle in self.poses.angles:
            limit = 90.0 if angle == "pitch" else 180.0
            self.dials.append(Dial(f"{angle} (°)", -limit, limit, 1.0))
        self.legend = []
        for number in (OPEN, COLLIDES, UNDECIDED, OBSTACLE):
            label, color = CLASSES[number]
            self.legend.append((color, label))
        self.legend.append((KINDS["obstacles"].color, "obstacle, in the light"))
        self.legend.append((ROBOT_FILL_COLOR, "robot"))

    # ---- configurations --------------------------------------------------------------------------

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the values of the dials at a configuration: metres, then degrees."""
        return self.poses.dial_values(q)

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these values of the dials, metres and degrees."""
        return self.poses.configuration_of(numbers)

    def describe(self, q: Floats) -> str:
        """Return state, clearance and rotation of a configuration as text."""
        space = self._space
        text = STATES[int(space.classify(q))]
        distance = float(space.clearance(q))
        if 0.0 < distance < math.inf:
            text += f", clearance at least {distance:.3f} {space.grid.unit}"
        rotation = space.rotations._describe(q[space.grid.dim :])
        return f"{text}  \n{rotation}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        """Return as text whether a path exists."""
        if self._space.is_connected(q0, q1):
            return "**A path exists: proven.**"
        if self._space.is_disconnected(q0, q1):
            return "**No path exists: proven.**"
        return "Whether a path exists is undecided at this resolution."

    # ---- robot, marks and path -------------------------------------------------------------------

    def place(self, q: Floats) -> None:
        """Move the robot."""
        self.robot = q
        self._robot.position, self._robot.wxyz = self.poses.pose(q)

    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""
        gizmo = self._gizmos[name]
        gizmo.position, gizmo.wxyz = self.poses.pose(q)

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:
        """Call ``moved`` when a user drags the start or the goal."""

        def drag(event: Any) -> None:
            """Report the configuration nearest to where the gizmo was dragged."""
            q = self.poses.nearest_configuration(event.target.position, event.target.wxyz)
            moved(q)
            # A user can rotate the gizmo in ways that the robot cannot; correct it, but only after
            # the drag.
            if event.phase == "end":
                self.mark(name, q)

        self._gizmos[name].on_update(drag)

    def _path_positions(self, q: Floats) -> Floats:
        """Return the positions at which a path is drawn."""
        dim = self._space.grid.dim
        positions = np.full((len(q), 3), 0.6 * self.stage.wall)  # the height in the plane
        positions[:, :dim] = q[:, :dim]
        return positions

    # ---- cells -----------------------------------------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add the slider of the cut and the checkboxes of what is drawn.

        They call ``changed`` when a user sets them. Returns them by label.
        """
        added: dict[str, Any] = {}
        stage = self.stage
        grid = self._space.grid
        if stage.has_height:
            label = f"cut at {grid.labels[2]}"
            low = round(float(stage.lower[2] + grid.spacing), 9)
            high = round(float(stage.upper[2]), 9)
            cut = gui.add_slider(label, low, high, round(self._step, 9), round(self.cut, 9))
            added[label] = cut
        labels = {name: KINDS[name].label for name in self.kinds}
        labels[SECTION] = "section" if stage.has_height else "ground"
        boxes = {}
        for name, label in labels.items():
            boxes[name] = gui.add_checkbox(label, name in self.shown)
            added[label] = boxes[name]

        def choose(_: Any) -> None:
            """Take the choices over, and draw them."""
            if stage.has_height:
                self.cut = float(cut.value)
            self.shown = {name for name, box in boxes.items() if box.value}
            changed()

        for handle in added.values():
            handle.on_update(choose)
        return added

    def draw(self) -> None:
        """Draw the cells; send only those parts that changed."""
        cell = int(self._space.rotations._find_cells(self.robot))
        lid = not (self.stage.has_height and SECTION in self.shown)
        with self._drawing:
            for name in (*self.kinds, SECTION):
                rotates = name == SECTION or KINDS[name].rotates
                wanted: CellsDrawing | None = None
                if name in self.shown:
                    wanted = CellsDrawing(cell if rotates else None, self.cut, lid)
                never_drawn = name not in self._drawn
                if never_drawn or self._drawn[name] != wanted:
                    self._draw_cells(name, wanted)
                    self._drawn[name] = wanted

    def _draw_cells(self, name: str, wanted: CellsDrawing | None) -> None:
        """Draw the section, or the cells of a kind; remove the drawing if there is nothing."""
        if wanted is None:
            self._server.scene.remove_by_name(f"/{name}")
            return
        blocks = self.cells.make_blocks(wanted.cell)
        if name == SECTION:
            self._add_image(f"/{name}", self.stage.make_section(blocks, wanted.cut))
            return
        kind = KINDS[name]
        vertices, triangles = self.stage.make_solid(blocks, kind, wanted.cut, wanted.lid)
        if len(triangles):
            self._add_mesh(f"/{name}", (vertices, triangles), kind.color, kind.opacity)
        else:
            self._server.scene.remove_by_name(f"/{name}")

    def invalidate(self) -> None:
        """Make :meth:`draw` redraw everything, because the map has changed."""
        with self._drawing:
            self.cells.invalidate()
            self._drawn.clear()

    def _add_image(self, name: str, section: Section) -> None:
        """Add a section of the map to the scene."""
        width, depth = section.upper - section.lower
        center = (section.lower + section.upper) / 2
        self._server.scene.add_image(
            name,
            section.image,
            float(width),
            float(depth),
            format="png",
            wxyz=(0.0, 1.0, 0.0, 0.0),  # turned about x, because y points down in viser's images
            position=lift(center.tolist(), section.height),
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_gizmo(self, name: str, color: str) -> Any:
        """Add a robot that can be dragged, with its name above it."""
        controls = self._server.scene.add_transform_controls(
            f"/{name}",
            scale=1.2 * self.size,
            line_width=3.0,
            active_axes=(True, True, self.stage.has_height),
            disable_rotations=not self.poses.angles,
            depth_test=False,
        )
        self._add_robot(f"/{name}", color)
        above = (0.0, 0.0, self.stage.wall + 0.5 * self.size)
        self._server.scene.add_label(f"/{name}/label", name, position=above)
        return controls

    def _add_robot(self, name: str, color: str) -> None:
        """Add the robot to a node of the scene.

        In the plane, a nose shows its heading, if it has one.
        """
        self._add_mesh(f"{name}/figure", self._surface, color)
        if len(self.glyph.nose) and self.poses.angles:
            above = np.full(3, 1.01 * self.stage.wall)
            corners = np.column_stack([self.glyph.nose[:3], above])
            triangle = np.array([[0, 1, 2]])
            self._add_mesh(f"{name}/nose", (corners, triangle), ROBOT_EDGE_COLOR)


class Poses:
    """Conversion of configurations to and from the values of dials, and poses in space.

    Attributes
    ----------
    angles : tuple of str
        Elements of :data:`ANGLES` by which the robot can rotate.
    """

    def __init__(self, dim: int, rotations: Rotations) -> None:
        """Find out by which angles a robot of a dimension can rotate."""
        self.dim = dim
        self._rotations = rotations
        q = np.array([*np.zeros(dim), *rotations._from_matrix(np.eye(3))])
        # Steps between configurations have an entry for each degree of freedom.
        degrees_of_freedom = rotations._steps_between(q, q).shape[-1] - dim
        self._first_angle = len(ANGLES) - degrees_of_freedom  # a yaw is the last one
        self.angles = ANGLES[self._first_angle :]

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the position, metres, and the :attr:`angles`, degrees."""
        degrees = Rotation.from_matrix(self._matrix(q)).as_euler("xyz", degrees=True)
        angles = np.round(degrees[self._first_angle :], 6)
        angles += 0.0  # no minus sign before zero
        return (*q[: self.dim].tolist(), *angles.tolist())

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these :meth:`dial_values`."""
        degrees = np.zeros(3)
        degrees[self._first_angle :] = numbers[self.dim :]
        matrix = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
        return np.array([*numbers[: self.dim], *self._rotations._from_matrix(matrix)])

    def pose(self, q: Floats) -> tuple[Floats, Floats]:
        """Return position and quaternion w, x, y, z of the robot in space."""
        return lift(q[: self.dim].tolist(), 0.0), to_quaternion(self._matrix(q))

    def nearest_configuration(self, position: Floats, wxyz: Floats) -> Floats:
        """Return the configuration nearest to a pose in space."""
        matrix = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
        return np.array([*position[: self.dim], *self._rotations._from_matrix(matrix)])

    def _matrix(self, q: Floats) -> Floats:
        """Return the rotation of a configuration, shape (3, 3); in the plane about z."""
        matrix = np.eye(3)
        matrix[: self.dim, : self.dim] = self._rotations._rotation_matrices(q)
        return matrix


def _choose_endpoints(space: Any, sampled: Any) -> dict[str, Floats]:
    """Choose FREE configurations of ``sampled`` far apart, upright if possible, as start and goal.

    Without a FREE cell, both are the center of the grid.
    """
    dim = space.grid.dim
    upright = space.rotations._from_matrix(np.eye(3))
    center = np.add(space.grid.lower, space.grid.upper) / 2
    samples = sample_free_configurations(sampled, np.array([*center, *upright]))
    # Prefer upright robots at the same positions, if any is free.
    upright_samples = samples.copy()
    upright_samples[:, dim:] = upright
    is_free = np.asarray(sampled.is_free(upright_samples))
    if is_free.any():
        samples = upright_samples[is_free]
    return farthest_pair(samples, samples[:, :dim])
