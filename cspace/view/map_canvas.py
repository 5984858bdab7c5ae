"""The canvas of a map: its cells, the robot, start and goal."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

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
    Canvas,
    Dial,
    farthest_pair,
    sample_free_configurations,
)
from cspace.view.scene import KINDS, SECTION, Section, SolidKind, Stage, make_robot_surface

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

ANGLES: Final = ("roll", "pitch", "yaw")
"""Rotations about the fixed axes x, then y, then z."""


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
        super().__init__(server, space, _choose_endpoints(space, cells) | given)
        grid = cells.drawn.grid
        self.glyph = Body(space.robot, space.rotations)
        self.poses = Poses(space.grid.dim, space.rotations)
        longest = grid.spacing * max(grid.shape)
        self.size = max(self.glyph.size, 0.012 * longest)
        self.stage = Stage(
            grid, wall=min(0.5 * max(self.glyph.size, 0.002 * longest), 0.03 * longest)
        )
        self.kinds = [
            name for name in KINDS if name != "unknown" or cells.drawn.workspace.unknown is not None
        ]
        self.shown = {*self.kinds, SECTION} - (
            {"mixed"} if self.stage.has_height else {"border", "mixed"}
        )
        self._drawn: dict[str, Hashable] = {}
        self._drawing = threading.Lock()
        self._surface = make_robot_surface(space.robot, self.stage.wall)
        self._robot = server.scene.add_frame("/robot", show_axes=False)
        self._add_robot("/robot", ROBOT_FILL_COLOR)
        self._gizmos = {name: self._add_gizmo(name, color) for name, color in MARKS.items()}
        back = np.array([-0.5, -1.0, 0.9] if self.stage.has_height else [0.0, -0.45, 1.0])
        self._place_camera(self.stage.lower, self.stage.upper, back)
        self._describe_panel()
        self.cut = self._choose_cut(points) if self.stage.has_height else float(self.stage.upper[2])

    def _choose_cut(self, points: Floats) -> float:
        """Return the height of the first cut, above the robot at start, goal and path."""
        about = np.concatenate([[*self.endpoints.values()], points])
        top = max(float(self.glyph.extent(q)[1, 2]) for q in about)
        return _ceil_to(min(top, float(self.stage.upper[2])), self._step)

    def _describe_panel(self) -> None:
        """Set the title, the dials and the legend."""
        space, grid, angles = self._space, self._space.grid, self.poses.angles
        shape = " x ".join(f"{n:,}" for n in grid.shape)
        suffix = f" x {space.rotations}" if space.rotations.names else ""
        self.title, self.about = (
            space.robot.name,
            f"{shape} cells of {grid.spacing:g} {grid.unit}{suffix}",
        )
        self.unit = grid.unit
        self._step = step = 10.0 ** math.floor(math.log10(grid.spacing))
        self.dials = [
            Dial(label, _floor_to(low, step), _ceil_to(high, step), step)
            for label, low, high in zip(grid.labels, grid.lower, grid.upper, strict=True)
        ]
        self.dials += [
            Dial(f"{angle} (°)", *((-90.0, 90.0) if angle == "pitch" else (-180.0, 180.0)), 1.0)
            for angle in angles
        ]
        self.legend = [
            (CLASSES[number][1], CLASSES[number][0])
            for number in (OPEN, COLLIDES, UNDECIDED, OBSTACLE)
        ]
        self.legend += [
            (KINDS["obstacles"].color, "obstacle, in the light"),
            (ROBOT_FILL_COLOR, "robot"),
        ]

    # ---- configurations --------------------------------------------------------------------------

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the position, metres, and the angles, degrees."""
        return (*self.poses.position(q), *self.poses.degrees(q))

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these dial values."""
        dim = self._space.grid.dim
        return self.poses.configuration_of(numbers[:dim], numbers[dim:])

    def interpolate(self, points: Floats, shares: Floats) -> Floats:
        """Interpolate a path at shares of its length."""
        return self.glyph.interpolate(points, shares)

    def describe(self, q: Floats) -> str:
        """Return state, clearance and rotation of a configuration as text."""
        return (
            f"{super().describe(q)}  \n{self._space.rotations.describe(q[self._space.grid.dim :])}"
        )

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
        positions = self.stage.positions(q)
        positions[:, 2] += 0.0 if self.stage.has_height else 0.6 * self.stage.wall
        return positions

    # ---- cells -----------------------------------------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add the slider of the cut and the checkboxes.

        Return them by label.
        """
        added: dict[str, Any] = {}
        step, stage = self._step, self.stage
        if stage.has_height:
            low, high = (
                _ceil_to(stage.lower[2] + self._space.grid.spacing, step),
                _ceil_to(stage.upper[2], step),
            )
            self.cut = min(max(self.cut, low), high)
            label = f"cut at {self._space.grid.labels[2]}"
            cut = added[label] = gui.add_slider(label, low, high, step, self.cut)

            def set_cut(event: Any) -> None:
                self.cut = float(event.target.value)
                changed()

            cut.on_update(set_cut)
        labels = {name: KINDS[name].label for name in self.kinds}
        labels[SECTION] = "section" if stage.has_height else "ground"
        for name, label in labels.items():
            checkbox = added[label] = gui.add_checkbox(label, name in self.shown)

            def set_shown(event: Any, name: str = name) -> None:
                (self.shown.add if event.target.value else self.shown.discard)(name)
                changed()

            checkbox.on_update(set_shown)
        return added

    def draw(self) -> None:
        """Draw the cells; send only those parts that changed."""
        with self._drawing:
            wanted = self._plan_drawing()
            for name in self._drawn.keys() - wanted.keys():
                self._server.scene.remove_by_name(name)
                del self._drawn[name]
            for name, (key, draw) in wanted.items():
                if self._drawn.get(name) != key:
                    draw(name)
                    self._drawn[name] = key

    def _plan_drawing(self) -> dict[str, tuple[Hashable, Callable[[str], None]]]:
        """Return the key and draw function of each node of the scene."""
        q, cut, stage, cells = self.robot, self.cut, self.stage, self.cells
        rotation = q[self._space.grid.dim :]
        cell = int(self._space.rotations.find_cells(q))
        lid = not (stage.has_height and SECTION in self.shown)
        wanted: dict[str, tuple[Hashable, Callable[[str], None]]] = {}

        def draw_solid(name: str, kind: SolidKind) -> None:
            surface = stage.solid(cells.at(rotation if kind.rotates else None), kind, cut, lid)
            if len(surface[1]):
                self._add_mesh(name, surface, kind.color, kind.opacity)
            else:
                self._server.scene.remove_by_name(name)

        def draw_section(name: str) -> None:
            self._add_image(name, stage.section(cells.at(rotation), cut))

        for name in self.shown - {SECTION}:
            kind = KINDS[name]
            key = cell if kind.rotates else -1, cut, lid
            wanted[f"/{name}"] = key, partial(draw_solid, kind=kind)
        if SECTION in self.shown:
            wanted[f"/{SECTION}"] = (cell, cut), draw_section
        return wanted

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
        self.bytes += section.image.nbytes

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
    """Conversion of configurations to and from positions, angles and poses.

    Attributes
    ----------
    angles : tuple of str
        Elements of :data:`ANGLES` by which the robot can rotate.
    """

    def __init__(self, dim: int, rotations: Rotations) -> None:
        self.dim, self._rotations = dim, rotations
        q = np.zeros(dim + len(rotations.names))
        q[-1] = 1.0
        self.angles = ANGLES[3 - (rotations.steps_between(q, q).shape[-1] - dim) :]

    def position(self, q: Floats) -> tuple[float, ...]:
        """Return the position of a configuration, metres."""
        return tuple(q[: self.dim].tolist())

    def degrees(self, q: Floats) -> tuple[float, ...]:
        """Return the :attr:`angles` of a configuration, degrees."""
        m = self._matrix(q)
        roll, yaw = math.atan2(m[2, 1], m[2, 2]), math.atan2(m[1, 0], m[0, 0])
        angles = np.degrees([roll, math.asin(-np.clip(m[2, 0], -1.0, 1.0)), yaw])
        return tuple((np.round(angles, 6) + 0.0).tolist()[3 - len(self.angles) :])

    def configuration_of(self, position: tuple[float, ...], degrees: tuple[float, ...]) -> Floats:
        """Return the configuration with a position, metres, and :attr:`angles`, degrees."""
        angles = np.zeros(3)
        angles[3 - len(degrees) :] = degrees
        matrix = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        return np.array([*position, *self._rotations.from_matrix(matrix)])

    def pose(self, q: Floats) -> tuple[Floats, Floats]:
        """Return position and quaternion w, x, y, z of the robot in space."""
        position = np.array([*self.position(q), 0.0][:3])
        return position, Rotation.from_matrix(self._matrix(q)).as_quat()[[3, 0, 1, 2]]

    def nearest_configuration(self, position: Floats, wxyz: Floats) -> Floats:
        """Return the configuration nearest to a pose in space."""
        matrix = Rotation.from_quat(np.asarray(wxyz)[[1, 2, 3, 0]]).as_matrix()
        return np.array([*np.asarray(position)[: self.dim], *self._rotations.from_matrix(matrix)])

    def _matrix(self, q: Floats) -> Floats:
        """Return the rotation matrix of a configuration.

        Its shape is (3, 3); a map of the plane rotates about z.
        """
        matrix = np.eye(3)
        matrix[: self.dim, : self.dim] = self._rotations.rotation_matrices(q)
        return matrix


def _choose_endpoints(space: Any, cells: Cells) -> dict[str, Floats]:
    """Return two FREE configurations far apart, or the center of the grid."""
    sampling_map, upright = cells.drawn, space.rotations.from_matrix(np.eye(3))
    samples = sample_free_configurations(
        sampling_map, np.array([*np.add(space.grid.lower, space.grid.upper) / 2, *upright])
    )
    upright_samples = samples.copy()
    upright_samples[:, space.grid.dim :] = upright
    free = np.asarray(sampling_map.is_free(upright_samples))
    samples = upright_samples[free] if free.any() else samples
    return farthest_pair(samples, samples[:, : space.grid.dim])


def _floor_to(value: float, step: float) -> float:
    """Round down to a multiple of ``step``, up to rounding errors."""
    return round(math.floor(value / step + 1e-9) * step, 9)


def _ceil_to(value: float, step: float) -> float:
    """Round up to a multiple of ``step``, up to rounding errors."""
    return round(math.ceil(value / step - 1e-9) * step, 9)
