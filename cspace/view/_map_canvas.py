"""The canvas of a map: its cells, the robot, start and goal."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace import Rotations
from cspace.inside import Floats, wrap_angles
from cspace.plot.scene import ROBOT_FILL_COLOR, SOLID_ENDPOINT_COLORS, CellClass, DrawnRobot
from cspace.view._blocks import KINDS, SECTION, Cells, lift, make_robot_surface, to_quaternion
from cspace.view._canvas import STATES, Canvas, Dial, choose_endpoints

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
    endpoints : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.

    Attributes
    ----------
    cells : Cells
    kinds : list of str
        Names in :data:`cspace.view._blocks.KINDS` that the map can have.
    shown : set of str
        Names of the kinds to draw, and SECTION. :meth:`draw` applies this and the other attributes.
    cut : float
        Height above which cells are omitted, metres.
    """

    def __init__(
        self, space: Any, server: ViserServer, points: Floats, endpoints: dict[str, Floats]
    ) -> None:
        """Draw the robot and both ends; :meth:`draw` draws cells."""
        grid = space.grid
        rotations = space.rotations
        self.body = DrawnRobot(space.drawn_robot, rotations)
        self.robot_reach = self.body.reach
        # Sizes stay visible on the page: walls half as high as the robot is long, but 0.1 % to
        # 3 % of the map's longest side, and gizmos at least 1.2 % of it.
        longest = grid.spacing * max(grid.shape)
        self._wall_height = float(np.clip(0.5 * self.body.size, 0.001 * longest, 0.03 * longest))
        self._gizmo_size = max(self.body.size, 0.012 * longest)
        self.cells = Cells(space, self._wall_height)
        drawn = self.cells.drawn
        self.poses = PoseDials(grid.dim, rotations, self.cells.floor)
        center = np.add(grid.lower, grid.upper) / 2
        not_turned = np.array([1.0, 0.0, 0.0, 0.0])
        fallback = self.poses.nearest_configuration(center, not_turned)
        chosen = choose_endpoints(drawn, fallback)
        given = {name: space.check_configuration(q, name) for name, q in endpoints.items()}
        super().__init__(server, space, chosen | given)
        self._has_height = grid.dim == 3
        self._is_solid = drawn.workspace.grid.dim == 3
        # Sliders have steps of a power of ten, at most the side of a cell.
        self._step = 10.0 ** math.floor(math.log10(grid.spacing))
        self.kinds = [*KINDS]
        unknown = drawn.workspace.unknown
        if unknown is None or not drawn.workspace.outer[unknown].any():
            self.kinds.remove("unknown")
        hidden = {"mixed"} if self._has_height else {"border", "mixed"}
        self.shown = {*self.kinds, SECTION} - hidden
        self.cut = self._choose_cut_height(points)
        self._drawn: dict[str, Any] = {}
        self._drawing = threading.Lock()
        self._surface = make_robot_surface(space.robot, self._wall_height)
        self._robot = server.scene.add_frame(
            "/robot",
            show_axes=bool(self.poses.angles),
            axes_length=self.body.reach,
            axes_radius=0.02 * self._gizmo_size,
        )
        self._add_mesh("/robot/body", self._surface, ROBOT_FILL_COLOR)
        self._gizmos = {name: self._add_gizmo(name) for name in SOLID_ENDPOINT_COLORS}
        back = np.array([-0.5, -1.0, 0.9] if self._is_solid else [0.0, -0.45, 1.0])
        self._place_camera(self.cells.scene.lower, self.cells.scene.upper, back)
        self._describe_panel()

    def _choose_cut_height(self, points: Floats) -> float:
        """Choose a height above the robot at start, goal and path, metres."""
        scene = self.cells.scene
        highest = float(scene.upper[2])
        if not self._is_solid:
            return highest
        if self._has_height:
            rows = np.concatenate([[*self.endpoints.values()], points])
            top = self.body.extents(rows)[:, 1, 2].max()
        else:
            top = self.cells.floor + self._space.robot.shape.outer.bounds[1][2]
        return float(np.clip(top, scene.lower[2] + self._space.grid.spacing, highest))

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
            Dial(f"{axis} ({unit})", round(low, 9), round(high, 9), self._step)
            for axis, unit, low, high in zip(
                grid.axes, grid.units, grid.lower, grid.upper, strict=True
            )
        ]
        for angle in self.poses.angles:
            limit = 90.0 if angle == "pitch" else 180.0
            self.dials.append(Dial(f"{angle} (°)", -limit, limit, 1.0))
        shown = [CellClass.OPEN, CellClass.COLLIDES, CellClass.UNDECIDED, CellClass.OBSTACLE]
        unknown = self.cells.drawn.workspace.unknown
        if unknown is not None and unknown.any():
            is_solid = "unknown" in self.kinds
            shown.append(CellClass.UNSEEN if is_solid else CellClass.ASSUMED)
        self.legend = [(each.label, each.color) for each in shown]
        self.legend.append(("obstacle, in the light", KINDS["obstacles"].color))
        self.legend.append(("robot", ROBOT_FILL_COLOR))

    # ---- configurations --------------------------------------------------------------------------

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Convert a configuration to dial values: position, then angles in degrees."""
        return self.poses.dial_values(q)

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Convert dial values, metres and degrees, to a configuration."""
        return self.poses.configuration_of(numbers)

    def describe(self, q: Floats) -> str:
        """Describe the state, clearance and rotation of a configuration."""
        space = self._space
        text = STATES[int(space.classify(q))]
        distance = float(space.clearance(q))
        if 0.0 < distance < math.inf:
            text += f", clearance at least {distance:.3f} {space.grid.unit}"
        rotation = self.body.describe_rotation(q[space.grid.dim :])
        return f"{text}  \n{rotation}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        """Describe whether a path between two configurations is proven."""
        if self._space.is_connected(q0, q1):
            return "**A path exists: proven.**"
        if self._space.is_disconnected(q0, q1):
            return "**No path exists: proven.**"
        return "Whether a path exists is undecided at this resolution."

    # ---- robot, endpoints and path --------------------------------------------------------------

    def place(self, q: Floats) -> None:
        """Move the robot."""
        self.robot = q
        self._robot.position, self._robot.wxyz = self.poses.pose(q)

    def set_endpoint(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""
        gizmo = self._gizmos[name]
        gizmo.position, gizmo.wxyz = self.poses.pose(q)

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:
        """Register ``moved`` for drags of an endpoint."""

        def drag(event: Any) -> None:
            """Call ``moved`` with the gizmo's nearest configuration."""
            q = self.poses.nearest_configuration(event.target.position, event.target.wxyz)
            moved(q)
            # A user can rotate the gizmo in ways that the robot cannot; correct it, but only after
            # the drag.
            if event.phase == "end":
                self.set_endpoint(name, q)

        self._gizmos[name].on_update(drag)

    def _path_positions(self, q: Floats) -> Floats:
        """Return a drawn path's positions, shape (n, 3)."""
        dim = self._space.grid.dim
        height = self.cells.floor + 0.6 * self._wall_height  # in the plane
        positions = np.full((len(q), 3), height)
        positions[:, :dim] = q[:, :dim]
        return positions

    # ---- cells -----------------------------------------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add inputs for the cut height and the kinds of cells drawn.

        The inputs call ``changed`` when a user sets them. Returns them by label.
        """
        added: dict[str, Any] = {}
        if self._is_solid:
            label = f"cut at z ({self._space.grid.unit})"
            scene = self.cells.scene
            low = scene.lower[2] + self._space.grid.spacing
            numbers = np.round([low, scene.upper[2], self._step, self.cut], 9)
            cut = added[label] = gui.add_slider(label, *numbers.tolist())
        labels = {name: KINDS[name].label for name in self.kinds}
        labels[SECTION] = "section" if self._has_height else "ground"
        for name, label in labels.items():
            added[label] = gui.add_checkbox(label, name in self.shown)

        def choose(_: Any) -> None:
            """Apply the inputs, and report the change."""
            if self._is_solid:
                self.cut = float(cut.value)
            self.shown = {name for name, label in labels.items() if added[label].value}
            changed()

        for handle in added.values():
            handle.on_update(choose)
        return added

    def draw(self) -> None:
        """Draw the cells at the robot's rotation; send only changed parts."""
        cell = self._space.rotations.cell_of(self.robot[self.poses.dim :]).item()
        with self._drawing, self._server.atomic():
            for name in (*self.kinds, SECTION):
                # A drawing depends on the cut, and on the rotation cell if the kind rotates; a
                # kind that is not shown has none.
                wanted = None
                if name in self.shown:
                    rotates = name == SECTION or KINDS[name].rotates
                    wanted = cell if rotates else None, self.cut
                never_drawn = name not in self._drawn
                if never_drawn or self._drawn[name] != wanted:
                    self._server.scene.remove_by_name(f"/{name}")
                    if wanted is not None:
                        self._draw_cells(name, *wanted)
                    self._drawn[name] = wanted

    def _draw_cells(self, name: str, cell: Any, cut: float) -> None:
        """Draw a kind of cells, or the section, at a rotation."""
        if name != SECTION:
            kind = KINDS[name]
            vertices, triangles = self.cells.make_solid(cell, kind, cut)
            if len(triangles):
                self._add_mesh(f"/{name}", (vertices, triangles), kind.color, kind.opacity)
            return
        section = self.cells.make_section(cell, cut)
        # The section lies on top of the solids that it cuts.
        height = cut + 1e-3 * self._gizmo_size if self._has_height else self.cells.floor
        width, depth = section.upper - section.lower
        center = (section.lower + section.upper) / 2
        self._server.scene.add_image(
            f"/{name}",
            section.image,
            float(width),
            float(depth),
            format="png",
            wxyz=(0.0, 1.0, 0.0, 0.0),  # turned about x, because y points down in viser's images
            position=lift(center.tolist(), height),
            cast_shadow=False,
            receive_shadow=False,
        )

    def invalidate(self) -> None:
        """Make :meth:`draw` redraw everything, because the map has changed."""
        with self._drawing:
            self.cells.invalidate()
            self._drawn.clear()

    def _add_gizmo(self, name: str) -> Any:
        """Add a robot that users can drag, with ``name`` above it."""
        scene = self._server.scene
        controls = scene.add_transform_controls(
            f"/{name}",
            scale=1.2 * self._gizmo_size,
            line_width=3.0,
            active_axes=(True, True, self._has_height),
            disable_rotations=not self.poses.angles,
            depth_test=False,
        )
        self._add_mesh(f"/{name}/body", self._surface, SOLID_ENDPOINT_COLORS[name])
        above = (0.0, 0.0, self._wall_height + 0.5 * self._gizmo_size)
        scene.add_label(f"/{name}/label", name, position=above)
        return controls


class PoseDials:
    """Conversion of configurations to and from dial values and poses in space.

    Attributes
    ----------
    angles : tuple of str
        Elements of :data:`ANGLES` that the robot can turn by.
    """

    def __init__(self, dim: int, rotations: Rotations, height: float = 0.0) -> None:
        """Choose the angles that a robot of a dimension can change.

        ``height`` is that of a plane map's robots in space, metres.
        """
        self.dim = dim
        self._height = height
        self._rotations = rotations
        # A configuration without rotation coordinates has no angles, with one it has a yaw, and
        # with the four of a quaternion it has all three.
        self._first_angle = {0: 3, 1: 2, 4: 0}[len(rotations.names)]
        self.angles = ANGLES[self._first_angle :]

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Convert a configuration to its position, metres, and :attr:`angles`, degrees."""
        degrees = Rotation.from_matrix(self._rotation_matrix(q)).as_euler("xyz", degrees=True)
        angles = np.round(degrees[self._first_angle :], 6) + 0.0  # no minus sign before zero
        return (*q[: self.dim].tolist(), *angles.tolist())

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Convert dial values, metres and degrees, to a configuration."""
        degrees = np.zeros(3)
        degrees[self._first_angle :] = numbers[self.dim :]
        return self._make_configuration(numbers, Rotation.from_euler("xyz", degrees, degrees=True))

    def pose(self, q: Floats) -> tuple[Floats, Floats]:
        """Convert a configuration to position and quaternion, w first."""
        return lift(q[: self.dim].tolist(), self._height), to_quaternion(self._rotation_matrix(q))

    def nearest_configuration(self, position: Floats, wxyz: Floats) -> Floats:
        """Return the configuration nearest to a pose in space."""
        return self._make_configuration(position, Rotation.from_quat(wxyz, scalar_first=True))

    def _make_configuration(self, position: Any, rotation: Rotation) -> Floats:
        """Return the configuration at a position with a rotation.

        A plane map ignores z of the position.
        """
        if len(self.angles) == 3:
            coordinates = rotation.as_quat()
        else:
            x, y, _ = rotation.apply((1.0, 0.0, 0.0))
            yaws = wrap_angles(np.arctan2([y], [x]))
            coordinates = yaws[: len(self.angles)]
        return np.array([*position[: self.dim], *coordinates])

    def _rotation_matrix(self, q: Floats) -> Floats:
        """Return the rotation matrix in space of a configuration, shape (3, 3)."""
        matrix = np.eye(3)
        matrix[: self.dim, : self.dim] = self._rotations.make_matrices(q[self.dim :], self.dim)
        return matrix
