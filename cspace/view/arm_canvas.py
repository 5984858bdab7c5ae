"""The canvas of an arm: links, obstacles, tool frame, path, and the closest pair."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.errors import InputError
from cspace.plot.arms import (
    ARM_CAMERA,
    GHOST_COLOR,
    GHOST_COUNT,
    VIEW_MARGIN_SHARE,
    ArmFigure,
    interpolate_joints,
)
from cspace.plot.artists import CLASSES, COLLIDES, ROBOT_FILL_COLOR, UNDECIDED
from cspace.rotations.base import TWO_PI, wrapped
from cspace.support.arrays import BLOCKED, FREE, MIXED, Floats
from cspace.view.canvas import (
    MARKS,
    STATES,
    Canvas,
    Dial,
    farthest_pair,
    sample_free_configurations,
    state_text,
)
from cspace.view.scene import KINDS, rgb
from cspace.view.tool import ToolFrame

if TYPE_CHECKING:
    from viser import ViserServer

STATE_COLORS: Final = {
    FREE: ROBOT_FILL_COLOR,
    MIXED: CLASSES[UNDECIDED][1],
    BLOCKED: CLASSES[COLLIDES][1],
}
"""Colour of the arm, by state."""
CONTACT_COLOR: Final = "#262626"
"""Colour of the line between the closest pair."""
UNREACHED_COLOR: Final = "#cc3311"
"""Colour of the line from the tool frame to a pose that it does not reach."""
MARK_OPACITY: Final = 0.35
"""Opacity of the arms at start and goal."""
GHOST_OPACITY: Final = 0.2
"""Opacity of the arms along a path."""
MAX_MESHED_BALLS: Final = 500
"""Largest number of balls that are drawn as a mesh; more are drawn as points."""
MIN_POINT_SHARE: Final = 1e-3
"""Smallest size of a point, as a share of the longest side of its cloud."""
TOOL_SIZE_SHARE: Final = 0.2
"""Length of the axes of the tool frame, as a share of the longest side of the box around the arm.
"""
_STEP_DEGREES: Final = 0.1
"""Step of the slider of a revolute joint, degrees."""
_STEP_METRES: Final = 1e-3


class ArmCanvas(Canvas):
    """Draw an arm among obstacles, its path, start and goal.

    Parameters
    ----------
    space : ArmSpace
    server : viser.ViserServer
    points : ndarray of float64, shape (n, size)
        A path; n is 0 without a path.
    marks : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.
    frame : str, optional
        Tool frame; see :class:`ToolFrame`.

    Attributes
    ----------
    tool : ToolFrame
    """

    tool: ToolFrame

    has_cells = False
    distance_name = "obstacle distance"

    def __init__(
        self,
        space: Any,
        server: ViserServer,
        points: Floats,
        marks: dict[str, Floats],
        frame: str | None = None,
    ) -> None:
        given = {name: space._check_configurations(q, name) for name, q in marks.items()}
        if "start" in given:
            given.setdefault("goal", given["start"])  # no goal yet
        samples = sample_free_configurations(
            space, np.zeros(space.size).clip(space.arm.lower, space.arm.upper)
        )
        super().__init__(server, space, farthest_pair(samples, samples) | given)
        space._check_configurations(points, "path")
        self._describe_panel()
        self._labels = {name: server.scene.add_label(f"/{name}/label", name) for name in MARKS}
        self._ghosts: list[Any] = []
        self._marks = dict(self.endpoints)
        self.robot = self.endpoints["start"]
        self._nodes: list[str] = []
        self._links_lock = (
            threading.RLock()
        )  # one thread draws links anew while others move and colour them
        self._is_stale = False
        self._draw_bodies()
        self.tool = ToolFrame(space, server, TOOL_SIZE_SHARE * self._frame_scene(), frame)

    def _describe_panel(self) -> None:
        """Set the title, the dials and the legend."""
        space, arm = self._space, self._space.arm
        self.title = arm.name
        counts = {"joint": arm.dof, "link": len(arm.links), "obstacle": len(space.obstacles)}
        self.about = ", ".join(
            f"{count} {name}{'s' * (count != 1)}" for name, count in counts.items()
        )
        self._scale = np.array([1.0 if unit == "m" else math.degrees(1.0) for unit in arm.units])
        steps = np.where(self._scale == 1.0, _STEP_METRES, _STEP_DEGREES)
        limit = np.where(space.periodic_axes, math.pi, TWO_PI)
        lower = (
            np.ceil(np.where(np.isinf(arm.lower), -limit, arm.lower) * self._scale / steps - 1e-6)
            * steps
        )
        upper = (
            np.floor(np.where(np.isinf(arm.upper), limit, arm.upper) * self._scale / steps + 1e-6)
            * steps
        )
        units = np.where(self._scale == 1.0, "m", "°")
        self.dials = [
            Dial(f"{joint} ({unit})", *numbers)
            for joint, unit, *numbers in zip(
                arm.joints,
                units.tolist(),
                lower.round(3).tolist(),
                upper.round(3).tolist(),
                steps.tolist(),
                strict=True,
            )
        ]
        self.legend = [
            (ROBOT_FILL_COLOR, "arm, FREE"),
            (STATE_COLORS[MIXED], "arm, undecided (MIXED)"),
        ]
        self.legend += [
            (STATE_COLORS[BLOCKED], "arm, BLOCKED"),
            (KINDS["obstacles"].color, "obstacle"),
        ]
        self.legend += [(GHOST_COLOR, "arm along the path"), (CONTACT_COLOR, "closest pair")]
        self.legend += [(UNREACHED_COLOR, "from the tool frame to a pose out of reach")]

    # ---- configurations --------------------------------------------------------------------------

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the joints in degrees or metres."""
        joints = wrapped(q, self._space.periodic_axes)
        return tuple(np.round(joints * self._scale, 3).tolist())

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these dial values, clipped to the limits."""
        arm = self._space.arm
        return np.asarray(np.clip(np.array(numbers) / self._scale, arm.lower, arm.upper))

    def interpolate(self, points: Floats, shares: Floats) -> Floats:
        """Interpolate a path at shares of its joint-space length."""
        return interpolate_joints(points, shares)

    def distance(self, q: Floats) -> Any:
        """Return the obstacle distance of configurations."""
        return self._space.obstacle_distance(q)

    def describe(self, q: Floats) -> str:
        """Show state and closest pair, and return them as text.

        Colour the arm by its state, and draw the pair.
        """
        state = int(self._space.classify(q))
        with self._links_lock:
            for link in self._links["robot"].values():
                link.color = rgb(STATE_COLORS[state])
        try:
            contact = self._space.closest(q)
        except InputError:  # the arm has no obstacle and no pair of links to check
            return state_text(state, math.inf, self.unit, self.distance_name)
        self._draw_line("/contact", contact.points, CONTACT_COLOR, 4.0)
        pair, apart = f"{contact.link} and {contact.other}", f"{contact.distance:.3f} m"
        label = apart if contact.distance else pair
        self._server.scene.add_label(
            "/contact/label", label, position=contact.points.mean(axis=0), anchor="bottom-left"
        )
        proven = f", at least {apart} apart: proven" if contact.distance else ""
        return f"{STATES[state]}  \nclosest pair: {pair}{proven}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        """Return as text whether the straight motion is proven free."""
        if _are_same(q0, q1):
            return "Set a goal below, or drag the tool."
        free = self._space.motion_is_free(q0, q1)
        return (
            "**The straight motion is free: proven.**"
            if free
            else "The straight motion is not proven free."
        )

    # ---- drawing ---------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw arm and obstacles again after a change of the scene."""
        if self._is_stale:
            self._is_stale = False
            self._draw_bodies()

    def invalidate(self) -> None:
        """Make :meth:`draw` redraw everything, because the scene has changed."""
        self._is_stale = True

    def _draw_bodies(self) -> None:
        """Draw the obstacles, and the arm at its configuration, at the start and at the goal."""
        space, color = self._space, KINDS["obstacles"].color
        self._figure = figure = ArmFigure(space, MAX_MESHED_BALLS)
        with self._links_lock, self._server.atomic():
            for node in self._nodes:
                self._server.scene.remove_by_name(node)
            for name, surface in figure.obstacles.items():
                if len(surface[1]):
                    self._add_mesh(f"/obstacles/{name}", surface, color)
                else:
                    self._add_cloud(
                        f"/obstacles/{name}",
                        surface[0],
                        float(space.obstacles[name].shape.outer.radii[0]),
                    )
            self._links = {"robot": self._add_links("robot", figure.links, ROBOT_FILL_COLOR, 1.0)}
            for name, mark_color in MARKS.items():
                self._links[name] = self._add_links(name, figure.moving, mark_color, MARK_OPACITY)
            self._nodes = [f"/obstacles/{name}" for name in figure.obstacles]
            self._nodes += [
                f"/{name}/{link}" for name, links in self._links.items() for link in links
            ]
            self._pose_arm("robot", self.robot)
            for name, q in self._marks.items():
                self.mark(name, q)

    def place(self, q: Floats) -> None:
        """Move the arm, and its tool frame with it."""
        self._stand(q)
        self.tool.follow(q)

    def reach(self) -> str:
        """Move the arm to the pose to which users dragged its tool frame, or as near as possible.

        Return the reason why it does not reach it; empty if it does.
        """
        q, problem = self.tool.solve(
            np.clip(self.robot, self._space.arm.lower, self._space.arm.upper)
        )
        self._stand(q)
        if problem:
            ends = np.stack([self._space.arm.pose(q, self.tool.name)[:3, 3], self.tool.pose[:3, 3]])
            self._draw_line("/gap", ends, UNREACHED_COLOR, 4.0)
        return problem

    def _stand(self, q: Floats) -> None:
        """Move the arm without its tool frame."""
        self.robot = q
        self._pose_arm("robot", q)
        self._show_marks()
        self._server.scene.remove_by_name("/gap")

    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""
        self._marks[name] = q
        self._pose_arm(name, q)
        self._show_marks()
        self._labels[name].position = self._figure.tip_positions(q[np.newaxis])[0]

    def draw_path(self, points: Floats) -> None:
        """Draw the path of the tool frame, and pale arms along it; see :meth:`Canvas.draw_path`."""
        for link in self._ghosts:
            link.remove()
        self._ghosts = []
        if len(points) > 1:
            shares = np.linspace(0.0, 1.0, GHOST_COUNT + 2)[
                1:-1
            ]  # start and goal have arms already
            poses = self._space.arm.poses(self.interpolate(points, shares))
            self._ghosts = [self._add_ghosts(link, poses[link]) for link in self._figure.moving]
        super().draw_path(points)

    def _path_positions(self, q: Floats) -> Floats:
        return np.asarray(self._space.arm.pose(q, self.tool.name)[..., :3, 3])

    def _add_ghosts(self, link: str, poses: Floats) -> Any:
        """Add copies of a link at poses, shape (n, 4, 4)."""
        vertices, faces = self._figure.links[link]
        self.bytes += vertices.nbytes + faces.nbytes
        return self._server.scene.add_batched_meshes_simple(
            f"/ghosts/{link}",
            vertices,
            faces,
            Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True),
            poses[:, :3, 3],
            batched_colors=rgb(ROBOT_FILL_COLOR),
            opacity=GHOST_OPACITY,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_cloud(self, name: str, centers: Floats, radius: float) -> None:
        """Draw balls of one radius as round points, which browsers draw far faster than meshes."""
        size = max(radius, MIN_POINT_SHARE * float(np.ptp(centers, axis=0).max()))
        points = self._server.scene.add_point_cloud(
            name,
            centers.astype(np.float32),
            rgb(KINDS["obstacles"].color),
            point_size=size,  # viser's size is a radius on the screen
            point_shape="circle",
            precision="float32",
        )
        self.bytes += points.points.nbytes

    def _add_links(
        self, name: str, links: Iterable[str], color: str, opacity: float
    ) -> dict[str, Any]:
        return {
            link: self._add_mesh(f"/{name}/{link}", self._figure.links[link], color, opacity)
            for link in links
        }

    def _show_marks(self) -> None:
        """Show the arms at start and goal.

        Where the robot is they stay hidden, as they would change its colour. A goal at the start is
        no goal yet, and stays hidden too.
        """
        with self._links_lock:
            for name, q in self._marks.items():
                is_set = name == "start" or not _are_same(q, self._marks["start"])
                self._labels[name].visible = is_set
                apart = not _are_same(q, self.robot)
                for link in self._links[name].values():
                    link.visible = is_set and apart

    def _pose_arm(self, name: str, q: Floats) -> None:
        """Move the links of an arm to a configuration."""
        poses = self._space.arm.poses(q)
        with self._links_lock, self._server.atomic():
            for link, handle in self._links[name].items():
                if link in poses:  # it may be detached but not yet erased
                    handle.position = poses[link][:3, 3]
                    handle.wxyz = Rotation.from_matrix(poses[link][:3, :3]).as_quat(
                        scalar_first=True
                    )

    def _frame_scene(self) -> float:
        """Place the camera in front of the arm and its obstacles.

        Return the longest side of the box around the arm, metres.
        """
        placed = [self._figure.pose_links(q) for q in self.endpoints.values()]
        points = np.concatenate([vertices for arm in placed for vertices, _ in arm.values()])
        lower, upper = points.min(axis=0), points.max(axis=0)
        margin = VIEW_MARGIN_SHARE * float(np.max(upper - lower))
        obstacles = self._figure.obstacles.values()
        clipped = (vertices.clip(lower - margin, upper + margin) for vertices, _ in obstacles)
        near = np.concatenate([points, *clipped])
        azimuth = math.radians(ARM_CAMERA[1])
        back = np.array([math.cos(azimuth), math.sin(azimuth), 0.6])
        self._place_camera(near.min(axis=0), near.max(axis=0), back)
        return float(np.max(upper - lower))


def _are_same(q0: Floats, q1: Floats) -> bool:
    """Return True if two configurations look the same."""
    return bool(np.allclose(q0, q1, atol=1e-3))
