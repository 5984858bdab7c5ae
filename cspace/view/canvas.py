"""The scene of a page: what is drawn of a map, renewed where it is not as it was."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Hashable
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.plot.artists import DARK, GOAL
from cspace.plot.route import Figurine, Floats
from cspace.view.cells import Blocks, Cells, Part, part_around
from cspace.view.poses import Poses
from cspace.view.scene import (
    KINDS,
    ROBOT,
    SECTION,
    STATIONS,
    Kind,
    Section,
    Solid,
    Stage,
    path_colors,
    rgb,
    robot_solid,
)

if TYPE_CHECKING:
    from viser import ViserServer

MARKS: Final = {"start": "#ffffff", "goal": GOAL}
"""Configurations that are marked, and their colours."""
FIELD: Final = math.radians(40.0)
"""Field of view of the camera, from top to bottom."""


class Canvas:
    """Draws a map with the robot, its path, the start and the goal.

    Parameters
    ----------
    server : viser.ViserServer
    space : CSpace or TiledCSpace
    cells : Cells
        Its cells.
    about : ndarray of float64, shape (n, dof)
        Configurations that are to be seen; cells above the robot at all of them are cut off.

    Attributes
    ----------
    cells : Cells
    kinds : list of str
        Those of :data:`cspace.view.scene.KINDS` that there can be.
    shown : set of str
        Those of them that are drawn, and SECTION; :meth:`draw` follows, as of the others.
    cut : float
        Metres above which cells are left out.
    robot : ndarray of float64, shape (dof,)
        Where the robot is; the cells are those at its rotation.
    part : Part or None
        What is drawn in smaller blocks, since one looks there.
    bytes : int
        Of arrays, sent so far to each client.
    """

    def __init__(self, server: ViserServer, space: Any, cells: Cells, about: Floats) -> None:
        self._server, self._space, self.cells = server, space, cells
        self.figurine = Figurine(space.robot, space.rotations)
        self.poses = Poses(space.grid.dim, space.rotations)
        longest = cells.grid.spacing * max(cells.grid.shape)
        self.size = max(self.figurine.size, 0.012 * longest)
        self.stage = Stage(cells.grid, wall=min(0.5 * max(self.figurine.size, 0.002 * longest), 0.03 * longest))
        self.kinds = [name for name in KINDS if name != "unknown" or cells.near.workspace.unknown is not None]
        self.shown = {*self.kinds, SECTION} - ({"mixed"} if self.stage.has_height else {"border", "mixed"})
        self.cut = float(self.stage.upper[2])
        if self.stage.has_height:
            self.cut = min(self.cut, max(float(self.figurine.extent(q)[1, 2]) for q in about))
        self.part: Part | None = None
        self.bytes = 0
        self._drawn: dict[str, Hashable] = {}
        self._drawing = threading.Lock()
        scene = server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light/ambient", intensity=1.6)
        for place, intensity in (((-0.4, -0.7, 1.0), 1.3), ((0.8, 0.3, 0.6), 0.5)):
            scene.add_light_directional(f"/light/{intensity}", intensity=intensity, position=place)
        self._solid = robot_solid(space.robot, self.stage.wall)
        self._body = server.scene.add_frame("/robot", show_axes=False)
        self._figure("/robot", ROBOT)
        self._gizmos = {name: self._gizmo(name, color) for name, color in MARKS.items()}
        self._aim()

    # ---- what stands on its own --------------------------------------------------------------------------------------

    def place(self, q: Floats) -> None:
        """Move the robot."""
        self.robot = q
        self._body.position, self._body.wxyz = self.poses.pose(q)

    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""
        gizmo = self._gizmos[name]
        gizmo.position, gizmo.wxyz = self.poses.pose(q)

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:
        """Have something told where the start or the goal is dragged to."""

        def dragged(event: Any) -> None:
            q = self.poses.of_pose(event.target.position, event.target.wxyz)
            moved(q)
            if event.phase == "end":  # turned as the robot cannot, it turns back; not under the hand that drags it
                self.mark(name, q)

        self._gizmos[name].on_update(dragged)

    def follow(self, points: Floats, clearance: Callable[[Floats], Floats]) -> float:
        """Draw a path, coloured by the clearance along it; its largest clearance."""
        if not len(points):
            self._server.scene.remove_by_name("/path")
            return math.nan
        along = self.figurine.along(points, np.linspace(0.0, 1.0, STATIONS))
        values = clearance(along)
        places = self.stage.point(along)
        places[:, 2] += 0.0 if self.stage.has_height else 0.6 * self.stage.wall
        colors = _as_light(path_colors(values))
        self._server.scene.add_line_segments(
            "/path",
            np.stack([places[:-1], places[1:]], axis=1),
            np.stack([colors[:-1], colors[1:]], axis=1),
            thickness=6.0,
            thickness_units="screen",
        )
        return float(np.max(values, initial=0.0, where=np.isfinite(values)))

    def look(self, look_at: Floats, position: Floats, field: float, aspect: float) -> bool:
        """Take note of where a camera looks; whether something is to be drawn for it."""
        reach = float(np.linalg.norm(position - look_at)) * math.tan(field / 2.0) * max(1.0, aspect)
        grid = self.cells.grid
        part = part_around(grid, look_at[: grid.dim], reach, self.cells.side)
        changed = part != self.part
        self.part = part
        return changed

    # ---- what the cells are ------------------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw the cells as they are to be seen now; what is as it was is not sent again."""
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
        """What is to be seen, by name: what it hangs on, and what draws it."""
        q, cut, part, shown, stage = self.robot, self.cut, self.part, set(self.shown), self.stage
        rotation, number = q[self._space.grid.dim :], int(self._space.rotations.cells_of(q))
        lid = not (stage.has_height and SECTION in shown)
        looks: list[tuple[str, Part | None, Callable[[Floats | None], Blocks]]] = [("whole", part, self.cells.whole)]
        if part is not None:
            looks.append(("part", None, partial(self.cells.part, part=part)))
        wanted: dict[str, tuple[Hashable, Callable[[str], None]]] = {}
        for where, hole, blocks in looks:

            def draw_solid(name: str, kind: Kind, look: Any = blocks, hole: Part | None = hole) -> None:
                solid = stage.solid(look(rotation if kind.turns else None), kind, cut, hole, lid)
                if len(solid.faces):
                    self._mesh(name, solid, kind.color, kind.opacity)
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
        """Draw all cells anew at the next call: the map has changed."""
        with self._drawing:
            self.cells.forget()
            self._drawn.clear()

    def _mesh(self, name: str, solid: Solid, color: str, opacity: float = 1.0) -> Any:
        self.bytes += solid.vertices.nbytes + solid.faces.nbytes
        return self._server.scene.add_mesh_simple(
            name,
            solid.vertices,
            solid.faces,
            color=rgb(color),
            opacity=None if opacity == 1.0 else opacity,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _picture(self, name: str, section: Section, above: bool) -> None:
        width, depth = section.upper - section.lower
        height = section.height + 1e-3 * width * above  # over the picture in whose hole it lies, which hides it else
        handle = self._server.scene.add_image(
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
        self.bytes += len(handle._data)

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
        self._mesh(f"{name}/figure", self._solid, color)
        if len(self.figurine.nose) and self.poses.angles:
            corners = np.column_stack([self.figurine.nose[:3], np.full(3, 1.01 * self.stage.wall)])
            self._mesh(f"{name}/nose", Solid(corners.astype(np.float32), np.array([[0, 1, 2]], dtype=np.uint32)), DARK)

    def _aim(self) -> None:
        """Have cameras begin where all of the map is in view."""
        lower, upper = self.stage.lower, self.stage.upper
        middle, half = (lower + upper) / 2, (upper - lower) / 2
        back = np.array([-0.5, -1.0, 0.9] if self.stage.has_height else [0.0, -0.45, 1.0])
        back /= np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        corners = half * np.array(list(product((-1.0, 1.0), repeat=3)))
        across = np.maximum(np.abs(corners @ right) / 1.2, np.abs(corners @ np.cross(back, right)))
        distance = 1.1 * float(np.max(across / math.tan(FIELD / 2.0) + corners @ back))
        camera = self._server.initial_camera
        camera.fov = FIELD
        camera.near, camera.far = 1e-3 * distance, 1e2 * distance
        camera.up = (0.0, 0.0, 1.0)
        camera.look_at = middle
        camera.position = middle + distance * back


def _as_light(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours as lines take them: in proportion to their light, and not as screens do (IEC 61966-2-1, sRGB)."""
    share = colors / 255.0
    return np.rint(255.0 * np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)).astype(np.uint8)
