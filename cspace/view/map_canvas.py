"""The canvas of a map: its cells, the robot, start and goal."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.errors import ConfigurationError
from cspace.plot.artists import (
    CLASSES,
    COLLIDES,
    OBSTACLE,
    OPEN,
    ROBOT_EDGE_COLOR,
    ROBOT_FILL_COLOR,
    UNDECIDED,
)
from cspace.plot.route import Body
from cspace.rotations import Rotations
from cspace.support.arrays import Floats
from cspace.view.blocks import Cells
from cspace.view.canvas import (
    MARKS,
    STATES,
    Canvas,
    Dial,
    farthest_pair,
    sample_free_configurations,
)
from cspace.view.scene import KINDS, SECTION, Section, Stage, make_robot_surface, to_quaternion

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

ANGLES: Final = ("roll", "pitch", "yaw")
"""Rotations about the fixed axes x, then y, then z."""

Part = tuple[int | None, float, bool]
"""What a drawn part depends on: a rotation cell, the cut, and whether the cut has a lid."""


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
        Names in :data:`cspace.view.scene.KINDS` that the map can have.
    shown : set of str
        Names of the kinds to draw, and SECTION. :meth:`draw` applies this and the other attributes.
    cut : float
        Height above which cells are omitted, metres.
    """

    def __init__(
        self, space: Any, server: ViserServer, points: Floats, marks: dict[str, Floats]
    ) -> None:
        given = {name: space.rotations.make_canonical(q, name) for name, q in marks.items()}
        self.cells = cells = Cells(space)
        super().__init__(server, space, _choose_endpoints(space, cells.drawn) | given)
        grid = cells.drawn.grid
        self.glyph = Body(space.robot, space.rotations)
        self.robot_reach = self.glyph.reach
        self.poses = Poses(space.grid.dim, space.rotations)
        self._step = 10.0 ** math.floor(math.log10(grid.spacing))
        longest = grid.spacing * max(grid.shape)
        self.size = max(self.glyph.size, 0.012 * longest)
        wall = min(0.5 * max(self.glyph.size, 0.002 * longest), 0.03 * longest)
        self.stage = stage = Stage(grid, wall)
        self.kinds = [*KINDS]
        if cells.drawn.workspace.unknown is None:
            self.kinds.remove("unknown")
        hidden = {"mixed"} if stage.has_height else {"border", "mixed"}
        self.shown = {*self.kinds, SECTION} - hidden
        self.cut = float(stage.upper[2])
        if stage.has_height:
            # Above the robot at start, goal and path.
            about = np.concatenate([[*self.endpoints.values()], points])
            top = float(self.glyph.extents(about)[:, 1, 2].max())
            top = math.ceil(top / self._step - 1e-9) * self._step
            self.cut = min(max(top, stage.lower[2] + grid.spacing), self.cut)
        self._drawn: dict[str, Part | None] = {}
        self._drawing = threading.Lock()
        self._surface = make_robot_surface(space.robot, stage.wall)
        self._robot = server.scene.add_frame("/robot", show_axes=False)
        self._add_robot("/robot", ROBOT_FILL_COLOR)
        self._gizmos = {name: self._add_gizmo(name, color) for name, color in MARKS.items()}
        back = np.array([-0.5, -1.0, 0.9] if stage.has_height else [0.0, -0.45, 1.0])
        self._place_camera(stage.lower, stage.upper, back)
        self._describe_panel()

    def _describe_panel(self) -> None:
        """Set the title, the dials and the legend."""
        space = self._space
        grid = self._space.grid
        angles = self.poses.angles
        shape = " x ".join(f"{n:,}" for n in grid.shape)
        suffix = f" x {space.rotations}" if space.rotations.names else ""
        self.title = space.robot.name
        self.about = f"{shape} cells of {grid.spacing:g} {grid.unit}{suffix}"
        self.dials = [
            Dial(label, round(low, 9), round(high, 9), self._step)
            for label, low, high in zip(grid.labels, grid.lower, grid.upper, strict=True)
        ]
        for angle in angles:
            limit = 90.0 if angle == "pitch" else 180.0
            self.dials.append(Dial(f"{angle} (°)", -limit, limit, 1.0))
        classes = [CLASSES[number] for number in (OPEN, COLLIDES, UNDECIDED, OBSTACLE)]
        self.legend = [(color, label) for label, color in classes]
        self.legend.append((KINDS["obstacles"].color, "obstacle, in the light"))
        self.legend.append((ROBOT_FILL_COLOR, "robot"))

    # ---- configurations --------------------------------------------------------------------------

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the position, metres, and the angles, degrees."""
        return self.poses.dial_values(q)

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these dial values."""
        return self.poses.configuration_of(numbers)

    def describe(self, q: Floats) -> str:
        """Return state, clearance and rotation of a configuration as text."""
        space = self._space
        text = STATES[int(self._space.classify(q))]
        with suppress(ConfigurationError):  # a tiled map lacks some clearances
            distance = float(space.clearance(q))
            if 0.0 < distance < math.inf:
                text += f", clearance at least {distance:.3f} {space.grid.unit}"
        return f"{text}  \n{space.rotations.describe(q[space.grid.dim :])}"

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
        height = 0.6 * self.stage.wall  # of a path in the plane
        return np.pad(q[:, :dim], ((0, 0), (0, 3 - dim)), constant_values=height)

    # ---- cells -----------------------------------------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add the slider of the cut and the checkboxes.

        Return them by label.
        """
        added: dict[str, Any] = {}
        stage = self.stage
        grid = self._space.grid
        if stage.has_height:
            label = f"cut at {grid.labels[2]}"
            numbers = stage.lower[2] + grid.spacing, stage.upper[2], self._step, self.cut
            low, high, step, value = (round(float(number), 9) for number in numbers)
            cut = added[label] = gui.add_slider(label, low, high, step, value)
        labels = {name: KINDS[name].label for name in self.kinds}
        labels[SECTION] = "section" if stage.has_height else "ground"
        boxes = {}
        for name, label in labels.items():
            boxes[name] = added[label] = gui.add_checkbox(label, name in self.shown)

        def choose(_: Any) -> None:
            if stage.has_height:
                self.cut = float(cut.value)
            self.shown = {name for name, box in boxes.items() if box.value}
            changed()

        for each in added.values():
            each.on_update(choose)
        return added

    def draw(self) -> None:
        """Draw the cells; send only those parts that changed."""
        cell = int(self._space.rotations.find_cells(self.robot))
        lid = not (self.stage.has_height and SECTION in self.shown)
        with self._drawing:
            for name in (*self.kinds, SECTION):
                rotates = name == SECTION or KINDS[name].rotates
                wanted = (cell if rotates else None, self.cut, lid) if name in self.shown else None
                if self._drawn.get(name, ()) != wanted:
                    if wanted is None or not self._draw_part(name, *wanted):
                        self._server.scene.remove_by_name(f"/{name}")
                    self._drawn[name] = wanted

    def _draw_part(self, name: str, cell: int | None, cut: float, lid: bool) -> bool:
        """Draw the section, or the cells of a kind; return False if there are none."""
        blocks = self.cells.at(cell)
        if name == SECTION:
            self._add_image(f"/{name}", self.stage.section(blocks, cut))
            return True
        kind = KINDS[name]
        surface = self.stage.solid(blocks, kind, cut, lid)
        if len(surface[1]):
            self._add_mesh(f"/{name}", surface, kind.color, kind.opacity)
        return len(surface[1]) > 0

    def invalidate(self) -> None:
        """Make :meth:`draw` redraw everything, because the map has changed."""
        with self._drawing:
            self.cells.invalidate()
            self._drawn.clear()

    def _add_image(self, name: str, section: Section) -> None:
        """Add a section of the map to the scene."""
        width, depth = section.upper - section.lower
        self._server.scene.add_image(
            name,
            section.image,
            float(width),
            float(depth),
            format="png",
            wxyz=(0.0, 1.0, 0.0, 0.0),
            position=(*((section.lower + section.upper) / 2).tolist(), section.height),
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
        self._server.scene.add_label(
            f"/{name}/label", name, position=(0.0, 0.0, self.stage.wall + 0.5 * self.size)
        )
        return controls

    def _add_robot(self, name: str, color: str) -> None:
        """Add the robot to a node of the scene.

        In the plane, a nose shows its heading, if it has one.
        """
        self._add_mesh(f"{name}/figure", self._surface, color)
        if len(self.glyph.nose) and self.poses.angles:
            corners = np.column_stack([self.glyph.nose[:3], np.full(3, 1.01 * self.stage.wall)])
            self._add_mesh(f"{name}/nose", (corners, np.array([[0, 1, 2]])), ROBOT_EDGE_COLOR)


class Poses:
    """Conversion of configurations to and from the values of dials, and poses in space.

    Attributes
    ----------
    angles : tuple of str
        Elements of :data:`ANGLES` by which the robot can rotate.
    """

    def __init__(self, dim: int, rotations: Rotations) -> None:
        self.dim = dim
        self._rotations = rotations
        q = np.array([*np.zeros(dim), *rotations.from_matrix(np.eye(3))])
        self.angles = ANGLES[3 - (rotations.steps_between(q, q).shape[-1] - dim) :]

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the position, metres, and the :attr:`angles`, degrees."""
        degrees = Rotation.from_matrix(self._matrix(q)).as_euler("xyz", degrees=True)
        shown = np.round(degrees[3 - len(self.angles) :], 6) + 0.0  # no minus sign before zero
        return (*q[: self.dim].tolist(), *shown.tolist())

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these :meth:`dial_values`."""
        degrees = np.zeros(3)
        degrees[3 - len(self.angles) :] = numbers[self.dim :]
        matrix = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
        return np.array([*numbers[: self.dim], *self._rotations.from_matrix(matrix)])

    def pose(self, q: Floats) -> tuple[Floats, Floats]:
        """Return position and quaternion w, x, y, z of the robot in space."""
        return np.array([*q[: self.dim], 0.0][:3]), to_quaternion(self._matrix(q))

    def nearest_configuration(self, position: Floats, wxyz: Floats) -> Floats:
        """Return the configuration nearest to a pose in space."""
        matrix = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
        return np.array([*position[: self.dim], *self._rotations.from_matrix(matrix)])

    def _matrix(self, q: Floats) -> Floats:
        """Return the rotation matrix of a configuration.

        Its shape is (3, 3); a map of the plane rotates about z.
        """
        matrix = np.eye(3)
        matrix[: self.dim, : self.dim] = self._rotations.rotation_matrices(q)
        return matrix


def _choose_endpoints(space: Any, sampled: Any) -> dict[str, Floats]:
    """Return two FREE configurations of ``sampled`` far apart, or the center of the grid.

    They are upright, if possible.
    """
    dim = space.grid.dim
    upright = space.rotations.from_matrix(np.eye(3))
    center = np.add(space.grid.lower, space.grid.upper) / 2
    samples = sample_free_configurations(sampled, np.array([*center, *upright]))
    turned = np.hstack([samples[:, :dim], np.tile(upright, (len(samples), 1))])
    free = np.asarray(sampled.is_free(turned))
    samples = turned[free] if free.any() else samples
    return farthest_pair(samples, samples[:, :dim])
