"""The canvas of a map: its cells, drawn anew only where they changed, and the robot among them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Hashable
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.arrays import Floats
from cspace.plot.artists import CLASSES, COLLIDES, DARK, OBSTACLE, OPEN, UNDECIDED
from cspace.plot.route import RobotGlyph
from cspace.rotations import Rotations
from cspace.view.canvas import MARKS, Canvas, Dial, far_apart, samples
from cspace.view.level_of_detail import Blocks, Cells, Part, part_around
from cspace.view.scene import KINDS, ROBOT, SECTION, Kind, Section, Stage, robot_surface

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

ANGLES: Final = ("roll", "pitch", "yaw")
"""Turns about x, then y, then z, all of which stay where they are."""


class MapCanvas(Canvas):
    """Draws a map with the robot, its path, the start and the goal.

    ``points`` are a path that is to be seen, shape (n, size), and cells above the robot on it are cut off; ``marks``
    are the start and the goal, where they are given.

    Attributes
    ----------
    cells : Cells
    kinds : list of str
        Those of :data:`cspace.view.scene.KINDS` that there can be.
    shown : set of str
        Those of them that are drawn, and SECTION; :meth:`draw` follows, as of the others.
    cut : float
        Metres above which cells are left out.
    part : Part or None
        What is drawn in smaller blocks, since one looks there.
    """

    def __init__(self, space: Any, cells: Cells, server: ViserServer, points: Floats, marks: dict[str, Floats]) -> None:
        given = {name: space.rotations.canonical(q, name) for name, q in marks.items()}
        super().__init__(server, space, _endpoints(space, cells) | given)
        self.cells, self.is_quick = cells, cells.quick
        self.figurine = RobotGlyph(space.robot, space.rotations)
        self.poses = Poses(space.grid.dim, space.rotations)
        longest = cells.grid.spacing * max(cells.grid.shape)
        self.size = max(self.figurine.size, 0.012 * longest)
        self.stage = Stage(cells.grid, wall=min(0.5 * max(self.figurine.size, 0.002 * longest), 0.03 * longest))
        self.kinds = [name for name in KINDS if name != "unknown" or cells.near.workspace.unknown is not None]
        self.shown = {*self.kinds, SECTION} - ({"mixed"} if self.stage.has_height else {"border", "mixed"})
        self.cut = float(self.stage.upper[2])
        if self.stage.has_height:
            about = np.concatenate([[*self.endpoints.values()], points])
            self.cut = min(self.cut, max(float(self.figurine.extent(q)[1, 2]) for q in about))
        self.part: Part | None = None
        self._drawn: dict[str, Hashable] = {}
        self._drawing = threading.Lock()
        self._surface = robot_surface(space.robot, self.stage.wall)
        self._robot = server.scene.add_frame("/robot", show_axes=False)
        self._figure("/robot", ROBOT)
        self._gizmos = {name: self._gizmo(name, color) for name, color in MARKS.items()}
        back = np.array([-0.5, -1.0, 0.9] if self.stage.has_height else [0.0, -0.45, 1.0])
        self._place_camera(self.stage.lower, self.stage.upper, back)
        self._set_panel()

    def _set_panel(self) -> None:
        """Set the title, the dials and the legend."""
        space, grid, angles = self._space, self._space.grid, self.poses.angles
        shape = " x ".join(f"{n:,}" for n in grid.shape)
        turns = f" x {space.rotations}" if space.rotations.names else ""
        self.title, self.about = space.robot.name, f"{shape} cells of {grid.spacing:g} {grid.unit}{turns}"
        self.unit = grid.unit
        self._step = step = 10.0 ** math.floor(math.log10(grid.spacing))
        self.dials = [
            Dial(label, _down(low, step), _up(high, step), step)
            for label, low, high in zip(grid.labels, grid.lower, grid.upper, strict=True)
        ]
        self.dials += [
            Dial(f"{angle} (°)", *((-90.0, 90.0) if angle == "pitch" else (-180.0, 180.0)), 1.0) for angle in angles
        ]
        self.typed = [(f"{', '.join(grid.axes)} ({grid.unit})", slice(0, grid.dim))]
        if angles:
            self.typed.append((f"{', '.join(angles)} (°)", slice(grid.dim, None)))
        self.legend = [(CLASSES[number][1], CLASSES[number][0]) for number in (OPEN, COLLIDES, UNDECIDED, OBSTACLE)]
        self.legend += [(KINDS["obstacles"].color, "obstacle, in the light"), (ROBOT, "robot")]

    # ---- configurations ----------------------------------------------------------------------------------------------

    def numbers(self, q: Floats) -> tuple[float, ...]:
        return (*self.poses.position(q), *self.poses.degrees(q))

    def of(self, numbers: tuple[float, ...]) -> Floats:
        dim = self._space.grid.dim
        return self.poses.of(numbers[:dim], numbers[dim:])

    def along(self, points: Floats, shares: Floats) -> Floats:
        return self.figurine.along(points, shares)

    def describe(self, q: Floats) -> str:
        return f"{super().describe(q)}  \n{self._space.rotations.describe(q[self._space.grid.dim :])}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        connected, disconnected = self._space._connectivity(q0, q1)
        if connected:
            return "**A path exists: proven.**"
        return (
            "**No path exists: proven.**"
            if disconnected
            else "It is undecided at this resolution whether a path exists."
        )

    # ---- what stands on its own --------------------------------------------------------------------------------------

    def place(self, q: Floats) -> None:
        self.robot = q
        self._robot.position, self._robot.wxyz = self.poses.pose(q)

    def mark(self, name: str, q: Floats) -> None:
        gizmo = self._gizmos[name]
        gizmo.position, gizmo.wxyz = self.poses.pose(q)

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:

        def dragged(event: Any) -> None:
            q = self.poses.of_pose(event.target.position, event.target.wxyz)
            moved(q)
            if event.phase == "end":  # turned as the robot cannot, it turns back; not under the hand that drags it
                self.mark(name, q)

        self._gizmos[name].on_update(dragged)

    def _traced(self, q: Floats) -> Floats:
        places = self.stage.point(q)
        places[:, 2] += 0.0 if self.stage.has_height else 0.6 * self.stage.wall
        return places

    def look(self, look_at: Floats, position: Floats, field: float, aspect: float) -> bool:
        reach = float(np.linalg.norm(position - look_at)) * math.tan(field / 2.0) * max(1.0, aspect)
        grid = self.cells.grid
        part = part_around(grid, look_at[: grid.dim], reach, self.cells.side)
        changed = part != self.part
        self.part = part
        return changed

    # ---- what the cells are ------------------------------------------------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        added: dict[str, Any] = {}
        step, stage = self._step, self.stage
        if stage.has_height:
            low, high = _up(stage.lower[2] + self._space.grid.spacing, step), _up(stage.upper[2], step)
            self.cut = min(max(_up(self.cut, step), low), high)
            label = f"cut at {self._space.grid.labels[2]}"
            cut = added[label] = gui.add_slider(label, low, high, step, self.cut)

            def pulled(event: Any) -> None:
                self.cut = float(event.target.value)
                changed()

            cut.on_update(pulled)
        labels = {name: KINDS[name].label for name in self.kinds}
        labels[SECTION] = "section" if stage.has_height else "ground"
        for name, label in labels.items():
            box = added[label] = gui.add_checkbox(label, name in self.shown)

            def ticked(event: Any, name: str = name) -> None:
                (self.shown.add if event.target.value else self.shown.discard)(name)
                changed()

            box.on_update(ticked)
        return added

    def draw(self) -> None:
        """Draw the cells as they are to be seen now; what has not changed is not sent again."""
        with self._drawing:
            wanted = self._wanted()
            for name in self._drawn.keys() - wanted.keys():
                self._server.scene.remove_by_name(name)
                del self._drawn[name]
            for name, (key, draw) in wanted.items():
                if self._drawn.get(name) != key:
                    draw(name)
                    self._drawn[name] = key

    def _wanted(self) -> dict[str, tuple[Hashable, Callable[[str], None]]]:
        """What is to be seen, by name: a key that changes where it must be drawn anew, and what draws it."""
        q, cut, part, shown, stage = self.robot, self.cut, self.part, set(self.shown), self.stage
        rotation, number = q[self._space.grid.dim :], int(self._space.rotations.cells_of(q))
        lid = not (stage.has_height and SECTION in shown)
        looks: list[tuple[str, Part | None, Callable[[Floats | None], Blocks]]] = [("whole", part, self.cells.whole)]
        if part is not None:
            looks.append(("part", None, partial(self.cells.part, part=part)))
        wanted: dict[str, tuple[Hashable, Callable[[str], None]]] = {}
        for where, hole, blocks in looks:

            def draw_solid(name: str, kind: Kind, look: Any = blocks, hole: Part | None = hole) -> None:
                surface = stage.solid(look(rotation if kind.turns else None), kind, cut, hole, lid)
                if len(surface[1]):
                    self._mesh(name, surface, kind.color, kind.opacity)
                else:
                    self._server.scene.remove_by_name(name)

            def draw_section(
                name: str, look: Any = blocks, hole: Part | None = hole, above: bool = where == "part"
            ) -> None:
                self._picture(name, stage.section(look(rotation), cut, hole), above)

            for name in shown - {SECTION}:
                key = number if KINDS[name].turns else -1, cut, part, lid
                wanted[f"/{name}/{where}"] = key, partial(draw_solid, kind=KINDS[name])
            if SECTION in shown:
                wanted[f"/{SECTION}/{where}"] = (number, cut, part), draw_section
        return wanted

    def forget(self) -> None:
        with self._drawing:
            self.cells.forget()
            self._drawn.clear()

    def _picture(self, name: str, section: Section, above: bool) -> None:
        width, depth = section.upper - section.lower
        height = section.height + 1e-3 * width * above  # over the picture in whose hole it lies, which hides it else
        self._server.scene.add_image(
            name,
            section.image,
            float(width),
            float(depth),
            format="png",
            wxyz=(0.0, 1.0, 0.0, 0.0),
            position=(*((section.lower + section.upper) / 2).tolist(), height),
            cast_shadow=False,
            receive_shadow=False,
        )
        self.bytes += section.image.nbytes

    def _gizmo(self, name: str, color: str) -> Any:
        """A robot that can be dragged, with its name above it."""
        controls = self._server.scene.add_transform_controls(
            f"/{name}",
            scale=1.2 * self.size,
            line_width=3.0,
            active_axes=(True, True, self.stage.has_height),
            disable_rotations=not self.poses.angles,
            depth_test=False,
        )
        self._figure(f"/{name}", color)
        self._server.scene.add_label(f"/{name}/label", name, position=(0.0, 0.0, self.stage.wall + 0.5 * self.size))
        return controls

    def _figure(self, name: str, color: str) -> None:
        """The robot, at a node; in the plane its nose shows where it looks, if it turns."""
        self._mesh(f"{name}/figure", self._surface, color)
        if len(self.figurine.nose) and self.poses.angles:
            corners = np.column_stack([self.figurine.nose[:3], np.full(3, 1.01 * self.stage.wall)])
            self._mesh(f"{name}/nose", (corners, np.array([[0, 1, 2]])), DARK)


class Poses:
    """The configurations of a map, of which the first numbers are a position in the plane or in space.

    Attributes
    ----------
    angles : tuple of str
        Those of :data:`ANGLES` that the robot can turn by.
    """

    def __init__(self, dim: int, rotations: Rotations) -> None:
        self.dim, self._rotations = dim, rotations
        q = np.zeros(dim + len(rotations.names))
        q[-1] = 1.0
        self.angles = ANGLES[3 - (rotations.steps(q, q).shape[-1] - dim) :]

    def position(self, q: Floats) -> tuple[float, ...]:
        """Metres."""
        return tuple(q[: self.dim].tolist())

    def degrees(self, q: Floats) -> tuple[float, ...]:
        """The :attr:`angles` of a configuration."""
        m = self._matrix(q)
        roll, yaw = math.atan2(m[2, 1], m[2, 2]), math.atan2(m[1, 0], m[0, 0])
        angles = np.degrees([roll, math.asin(-np.clip(m[2, 0], -1.0, 1.0)), yaw])
        return tuple((np.round(angles, 6) + 0.0).tolist()[3 - len(self.angles) :])

    def of(self, position: tuple[float, ...], degrees: tuple[float, ...]) -> Floats:
        """The configuration of a position and :attr:`angles`."""
        angles = np.zeros(3)
        angles[3 - len(degrees) :] = degrees
        matrix = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        return np.array([*position, *self._rotations.of_matrix(matrix)])

    def pose(self, q: Floats) -> tuple[Floats, Floats]:
        """Where the robot stands in space: a position, and a quaternion w, x, y, z."""
        place = np.array([*self.position(q), 0.0][:3])
        return place, Rotation.from_matrix(self._matrix(q)).as_quat()[[3, 0, 1, 2]]

    def of_pose(self, place: Floats, wxyz: Floats) -> Floats:
        """The configuration nearest to a pose in space."""
        matrix = Rotation.from_quat(np.asarray(wxyz)[[1, 2, 3, 0]]).as_matrix()
        return np.array([*np.asarray(place)[: self.dim], *self._rotations.of_matrix(matrix)])

    def _matrix(self, q: Floats) -> Floats:
        matrix = np.eye(3)
        matrix[: self.dim, : self.dim] = self._rotations.matrices(q)
        return matrix


def _endpoints(space: Any, cells: Cells) -> dict[str, Floats]:
    """Two FREE configurations far apart; of a map that has none, the middle of its grid."""
    near, upright = cells.near, space.rotations.of_matrix(np.eye(3))
    drawn = samples(near, np.array([*np.add(space.grid.lower, space.grid.upper) / 2, *upright]))
    stood = drawn.copy()
    stood[:, space.grid.dim :] = upright
    free = np.asarray(near.is_free(stood))
    drawn = stood[free] if free.any() else drawn
    return far_apart(drawn, drawn[:, : space.grid.dim])


def _down(value: float, step: float) -> float:
    return round(math.floor(value / step + 1e-9) * step, 9)


def _up(value: float, step: float) -> float:
    return round(math.ceil(value / step - 1e-9) * step, 9)
