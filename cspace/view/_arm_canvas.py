"""The canvas of an arm: links, obstacles, tool frame, path, and the closest pair."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace import BLOCKED, FREE, MIXED
from cspace.errors import InputError
from cspace.inside import Balls, Floats, transform_surface, wrap_angles
from cspace.plot.scene import (
    GHOST_COLOR,
    ROBOT_FILL_COLOR,
    SOLID_ENDPOINT_COLORS,
    ArmFigure,
    CellClass,
)
from cspace.view._blocks import KINDS, hex_to_rgb, to_quaternion
from cspace.view._canvas import STATES, Canvas, Dial, choose_endpoints
from cspace.view._tool import ToolFrame

if TYPE_CHECKING:
    from viser import ViserServer

STATE_COLORS: Final = {
    FREE: ROBOT_FILL_COLOR,
    MIXED: CellClass.UNDECIDED.color,
    BLOCKED: CellClass.COLLIDES.color,
}
"""Colour of the arm, by state."""
GHOST_COUNT: Final = 5
"""Number of pale arms along a path."""
CONTACT_COLOR: Final = "#262626"
"""Colour of the line between the closest pair."""


class ArmCanvas(Canvas):
    """Draw an arm among obstacles, its path, start and goal.

    Parameters
    ----------
    space : ArmSpace
    server : viser.ViserServer
    points : ndarray of float64, shape (n, size)
        A path; n is 0 without a path.
    endpoints : dict of str to ndarray of float64, shape (size,)
        Start and goal, if given.
    frame : str, optional
        Tool frame; see :class:`ToolFrame`.

    Attributes
    ----------
    tool : ToolFrame
    """

    tool: ToolFrame

    def __init__(
        self,
        space: Any,
        server: ViserServer,
        points: Floats,
        endpoints: dict[str, Floats],
        frame: str | None = None,
    ) -> None:
        """Draw the arm at the start, and pale at both ends."""
        arm = space.arm
        given = {name: space.check_configuration(q, name) for name, q in endpoints.items()}
        if "start" in given:
            given.setdefault("goal", given["start"])  # no goal yet
        super().__init__(server, space, choose_endpoints(space, arm.configuration()) | given)
        self._describe_panel()
        self._ghosts: list[Any] = []
        self._shown_endpoints = dict(self.endpoints)
        self.robot = self.endpoints["start"]
        # One thread draws links anew while others move and colour them.
        self._links_lock = threading.RLock()
        self.invalidate()
        # Axes of a fifth of the arm's size are easy to grab, and hide little of it.
        counts = self._figure.joint_counts
        self.tool = ToolFrame(space, server, 0.2 * self._aim_camera(), counts, frame)

    def _describe_panel(self) -> None:
        """Set the title, the dials and the legend."""
        space = self._space
        arm = space.arm
        self.title = arm.name
        counts = {"joint": arm.dof, "link": len(arm.links), "obstacle": len(space.obstacles)}
        words = [f"{n} {name}" if n == 1 else f"{n} {name}s" for name, n in counts.items()]
        self.about = ", ".join(words)
        # Users set angles in degrees, in steps of a tenth, and lengths in millimetres. A joint
        # without limits has a turn, or two if it is not periodic.
        is_linear = np.array(arm.units) == "m"
        self._scale = np.where(is_linear, 1.0, math.degrees(1.0))
        steps = np.where(is_linear, 1e-3, 0.1)
        unlimited = np.where(space.is_periodic, math.pi, math.tau)
        lower = np.maximum(arm.lower, -unlimited) * self._scale
        upper = np.minimum(arm.upper, unlimited) * self._scale
        # Sliders have whole steps within the limits; 1e-6 absorbs rounding in limits that are
        # whole steps themselves.
        lower = np.round(np.ceil(lower / steps - 1e-6) * steps, 3)
        upper = np.round(np.floor(upper / steps + 1e-6) * steps, 3)
        units = np.where(is_linear, "m", "°")
        self.dials = []
        for joint, unit, *numbers in zip(arm.joints, units, lower, upper, steps, strict=True):
            self.dials.append(Dial(f"{joint} ({unit})", *map(float, numbers)))
        self.legend = [
            ("arm, FREE", STATE_COLORS[FREE]),
            ("arm, undecided (MIXED)", STATE_COLORS[MIXED]),
            ("arm, BLOCKED", STATE_COLORS[BLOCKED]),
            ("obstacle", KINDS["obstacles"].color),
            ("arm along the path", GHOST_COLOR),
            ("closest pair", CONTACT_COLOR),
        ]

    # ---- configurations --------------------------------------------------------------------------

    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return a configuration's joint values, degrees or metres."""
        joints = wrap_angles(q, self._space.is_periodic)
        return tuple(np.round(joints * self._scale, 3).tolist())

    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Convert dial values to a configuration within limits."""
        arm = self._space.arm
        return np.asarray(np.clip(np.array(numbers) / self._scale, arm.lower, arm.upper))

    def describe(self, q: Floats) -> str:
        """Show the arm's state and closest pair; return both as text."""
        state = int(self._space.classify(q))
        # A worker may describe the arm while another thread draws it anew.
        with self._links_lock:
            for link in self._links["robot"].values():
                link.color = hex_to_rgb(STATE_COLORS[state])
        try:
            contact = self._space.closest(q)
        except InputError:  # the arm has no obstacle and no pair of links to check
            return STATES[state]
        # In collision, the pair has no proven distance, so its names are the label.
        pair = f"{contact.link} and {contact.other}"
        label = pair
        proof = ""
        if contact.distance:
            label = f"{contact.distance:.3f} m"
            proof = f", at least {label} apart: proven"
        middle = contact.points.mean(axis=0)
        self._draw_line("/contact", contact.points, CONTACT_COLOR, thickness=4.0)
        self._server.scene.add_label("/contact/label", label, position=middle, anchor="bottom-left")
        return f"{STATES[state]}  \nclosest pair: {pair}{proof}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        """Return, as text, whether a motion is proven free."""
        if _are_same(q0, q1):
            return "Set a goal below, or drag the tool."
        if self._space.motion_is_free(q0, q1):
            return "**The straight motion is free: proven.**"
        return "The straight motion is not proven free."

    # ---- drawing ---------------------------------------------------------------------------------

    def invalidate(self) -> None:
        """Redraw the obstacles and all arms, because the space has changed."""
        scene = self._server.scene
        self._figure = ArmFigure(self._space.arm)
        self._obstacle_points: list[Floats] = []
        with self._links_lock, self._server.atomic():
            # Remove what was drawn before.
            for group in ("obstacles", "robot", *SOLID_ENDPOINT_COLORS):
                scene.remove_by_name(f"/{group}")
                scene.add_frame(f"/{group}", show_axes=False)
            for name, obstacle in self._space.snapshot.obstacles.items():
                if obstacle is not None:
                    self._add_obstacle(f"/obstacles/{name}", obstacle.shape.outer, obstacle.pose)
            self._links = {"robot": self._add_links("robot", [*self._figure.links])}
            for name, color in SOLID_ENDPOINT_COLORS.items():
                self._links[name] = self._add_links(name, self._figure.moving, color, 0.35)
            names = SOLID_ENDPOINT_COLORS
            self._labels = {name: scene.add_label(f"/{name}/label", name) for name in names}
            self._pose_arm("robot", self.robot)
            for name, q in self._shown_endpoints.items():
                self.set_endpoint(name, q)

    def _add_links(
        self, arm: str, links: Sequence[str], color: str = ROBOT_FILL_COLOR, opacity: float = 1.0
    ) -> dict[str, Any]:
        """Add an arm's links to the scene; return handles."""
        surfaces = self._figure.links
        add = self._add_mesh
        return {link: add(f"/{arm}/{link}", surfaces[link], color, opacity) for link in links}

    def _add_obstacle(self, name: str, shape: Any, pose: Floats) -> None:
        """Add an obstacle to the scene.

        Many balls of one radius are drawn as round points, far faster than as a mesh.
        """
        color = KINDS["obstacles"].color
        # Largest number of balls that are drawn as a mesh; more are drawn as points.
        are_points = isinstance(shape, Balls) and len(shape.radii) > 500
        if not are_points or np.ptp(shape.radii):  # points have one size
            surface = transform_surface(shape.surface, pose)
            self._obstacle_points.append(surface[0])
            self._add_mesh(name, surface, color)
            return
        centers = shape.centers @ pose[:3, :3].T + pose[:3, 3]
        self._obstacle_points.append(centers)
        # Points are visible from where all are in view; viser's size is a radius on the screen.
        size = max(float(shape.radii[0]), 1e-3 * float(np.ptp(centers, axis=0).max()))
        self._server.scene.add_point_cloud(
            name,
            centers,
            hex_to_rgb(color),
            point_size=size,
            point_shape="circle",
            precision="float32",
        )

    def place(self, q: Floats) -> None:
        """Move the arm, and its tool frame with it."""
        self.robot = q
        self._pose_arm("robot", q)
        self._show_endpoints()
        self.tool.follow(q)

    def reach(self) -> str:
        """Move the arm as near as possible to its dragged tool frame.

        Returns the reason why the arm does not reach the frame; empty if it does.
        """
        arm = self._space.arm
        near = self.robot.clip(arm.lower, arm.upper)
        q, problem = self.tool.solve(near)
        self.place(q)
        return problem

    def set_endpoint(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""
        self._shown_endpoints[name] = q
        self._pose_arm(name, q)
        self._show_endpoints()
        self._labels[name].position = self._figure.tip_positions(q[np.newaxis])[0]

    def draw_path(self, points: Floats) -> None:
        """Draw the path of the tool frame, and pale arms along it.

        Without points, remove both.
        """
        for link in self._ghosts:
            link.remove()
        self._ghosts = []
        if len(points) > 1:
            shares = np.linspace(0.0, 1.0, GHOST_COUNT + 2)
            between = shares[1:-1]  # start and goal have arms already
            poses = self._space.arm.poses(self.interpolate(points, between))
            self._ghosts = [self._add_ghosts(link, poses[link]) for link in self._figure.moving]
        super().draw_path(points)

    def _path_positions(self, q: Floats) -> Floats:
        """Return the positions of the tool frame at configurations, shape (n, 3)."""
        return np.asarray(self._space.arm.pose(q, self.tool.name)[..., :3, 3])

    def _add_ghosts(self, link: str, poses: Floats) -> Any:
        """Add copies of a link at poses, shape (n, 4, 4)."""
        vertices, faces = self._figure.links[link]
        return self._server.scene.add_batched_meshes_simple(
            f"/ghosts/{link}",
            vertices,
            faces,
            to_quaternion(poses),
            poses[:, :3, 3],
            batched_colors=hex_to_rgb(ROBOT_FILL_COLOR),
            opacity=0.2,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _show_endpoints(self) -> None:
        """Show or hide the pale arms at both ends.

        An arm at the robot's configuration is hidden, because it would tint the robot. A goal at
        the start is hidden too, because it is not set yet.
        """
        with self._links_lock:
            for name, q in self._shown_endpoints.items():
                is_set = name == "start" or not _are_same(q, self._shown_endpoints["start"])
                is_apart = not _are_same(q, self.robot)
                self._labels[name].visible = is_set
                for link in self._links[name].values():
                    link.visible = is_set and is_apart

    def _pose_arm(self, name: str, q: Floats) -> None:
        """Move the links of an arm to a configuration."""
        poses = self._space.arm.poses(q)
        with self._links_lock, self._server.atomic():
            for link, handle in self._links[name].items():
                if link in poses:  # a detached object has no pose, but is drawn until a redraw
                    handle.position = poses[link][:3, 3]
                    handle.wxyz = to_quaternion(poses[link])

    def _aim_camera(self) -> float:
        """Place the camera in front of the arm and its obstacles.

        Returns the longest side of the box around the arm, metres.
        """
        box, near = self._figure.measure(self.endpoints.values())
        corners = np.concatenate([box, *(points.clip(*near) for points in self._obstacle_points)])
        # From the side of pictures on paper, looking a little down.
        azimuth = math.radians(-40.0)
        back = np.array([math.cos(azimuth), math.sin(azimuth), 0.6])
        self._place_camera(corners.min(axis=0), corners.max(axis=0), back)
        return float(np.max(box[1] - box[0]))


def _are_same(q0: Floats, q1: Floats) -> bool:
    """Return True if configurations look alike: within 1 mm, 1 mrad."""
    return bool(np.allclose(q0, q1, atol=1e-3))
