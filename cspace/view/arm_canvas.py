"""The canvas of an arm: links, obstacles, path, and the closest pair."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.arrays import BLOCKED, FREE, MIXED, Floats
from cspace.errors import InputError
from cspace.plot.arms import VIEW_MARGIN_SHARE, ArmFigure, interpolate_joints
from cspace.plot.artists import CLASSES, COLLIDES, ROBOT_FILL_COLOR, UNDECIDED
from cspace.rotations.base import TWO_PI, wrapped
from cspace.view.canvas import MARKS, Canvas, Dial, farthest_pair, sample_free_configurations, state_text, to_linear_rgb
from cspace.view.scene import KINDS, rgb

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

STATE_COLORS: Final = {FREE: ROBOT_FILL_COLOR, MIXED: CLASSES[UNDECIDED][1], BLOCKED: CLASSES[COLLIDES][1]}
"""Colour of the arm, by state."""
CONTACT_COLOR: Final = "#262626"
"""Colour of the line between the closest pair."""
MARK_OPACITY: Final = 0.35
"""Opacity of the arms at start and goal."""
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
    """

    has_cells = False
    distance_name = "obstacle distance"

    def __init__(self, space: Any, server: ViserServer, points: Floats, marks: dict[str, Floats]) -> None:
        given = {name: space._check_configurations(q, name) for name, q in marks.items()}
        samples = sample_free_configurations(space, np.zeros(space.size).clip(space.arm.lower, space.arm.upper))
        super().__init__(server, space, farthest_pair(samples, samples) | given)
        space._check_configurations(points, "path")
        arm = space.arm
        self._figure = ArmFigure(space)
        self.title = arm.name
        counts = {"joint": arm.dof, "link": len(arm.links), "obstacle": len(space.obstacles)}
        self.about = ", ".join(f"{count} {name}{'s' * (count != 1)}" for name, count in counts.items())
        self._scale = np.array([1.0 if unit == "m" else math.degrees(1.0) for unit in arm.units])
        steps = np.where(self._scale == 1.0, _STEP_METRES, _STEP_DEGREES)
        limit = np.where(space.periodic_axes, math.pi, TWO_PI)
        lower = np.ceil(np.where(np.isinf(arm.lower), -limit, arm.lower) * self._scale / steps - 1e-6) * steps
        upper = np.floor(np.where(np.isinf(arm.upper), limit, arm.upper) * self._scale / steps + 1e-6) * steps
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
        self.typed = []
        self.legend = [(ROBOT_FILL_COLOR, "arm, FREE"), (STATE_COLORS[MIXED], "arm, undecided (MIXED)")]
        self.legend += [(STATE_COLORS[BLOCKED], "arm, BLOCKED"), (KINDS["obstacles"].color, "obstacle")]
        self.legend += [(CONTACT_COLOR, "closest pair")]
        for name, surface in self._figure.obstacles.items():
            self._add_mesh(f"/obstacles/{name}", surface, KINDS["obstacles"].color)
        self._links = {"robot": self._add_links("robot", self._figure.links, ROBOT_FILL_COLOR, 1.0)}
        self._links |= {
            name: self._add_links(name, self._figure.moving, color, MARK_OPACITY) for name, color in MARKS.items()
        }
        self._labels = {name: server.scene.add_label(f"/{name}/label", name) for name in MARKS}
        self._frame_scene()

    # ---- configurations ----------------------------------------------------------------------------------------------

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
        for link in self._links["robot"].values():
            link.color = rgb(STATE_COLORS[state])
        try:
            contact = self._space.closest(q)
        except InputError:  # the arm has no obstacle and no pair of links to check
            return state_text(state, math.inf, self.unit, self.distance_name)
        self._server.scene.add_line_segments(
            "/contact",
            contact.points[np.newaxis],
            np.broadcast_to(to_linear_rgb(np.array(rgb(CONTACT_COLOR), dtype=np.uint8)), (1, 2, 3)),
            thickness=4.0,
            thickness_units="screen",
        )
        text = state_text(state, contact.distance, self.unit, self.distance_name)
        return f"{text}  \nclosest pair: {contact.link} and {contact.other}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        """Return as text whether the straight motion is proven free."""
        free = self._space.motion_is_free(q0, q1)
        return "**The straight motion is free: proven.**" if free else "The straight motion is not proven free."

    # ---- drawing -----------------------------------------------------------------------------------------------------

    def place(self, q: Floats) -> None:
        """Move the arm."""
        self.robot = q
        self._pose_arm("robot", q)

    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""
        self._pose_arm(name, q)
        self._labels[name].position = self._figure.tip_positions(q[np.newaxis])[0]

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add a box that shows or hides start and goal."""
        checkbox = gui.add_checkbox("start and goal", True)

        def set_visible(event: Any) -> None:
            for name in MARKS:
                for link in (*self._links[name].values(), self._labels[name]):
                    link.visible = event.target.value

        checkbox.on_update(set_visible)
        return {"start and goal": checkbox}

    def _path_positions(self, q: Floats) -> Floats:
        return self._figure.tip_positions(q)

    def _add_links(self, name: str, links: Iterable[str], color: str, opacity: float) -> dict[str, Any]:
        return {link: self._add_mesh(f"/{name}/{link}", self._figure.links[link], color, opacity) for link in links}

    def _pose_arm(self, name: str, q: Floats) -> None:
        """Move the links of an arm to a configuration."""
        poses = self._space.arm.poses(q)
        with self._server.atomic():
            for link, handle in self._links[name].items():
                handle.position = poses[link][:3, 3]
                handle.wxyz = Rotation.from_matrix(poses[link][:3, :3]).as_quat(scalar_first=True)

    def _frame_scene(self) -> None:
        """Place the camera in front of the arm and its obstacles."""
        arms = [points for q in self.endpoints.values() for points, _ in self._figure.pose_links(q).values()]
        lower, upper = np.min([points.min(axis=0) for points in arms], 0), np.max([p.max(axis=0) for p in arms], 0)
        azimuth, margin = self._figure.camera_azimuth(lower, upper), VIEW_MARGIN_SHARE * float(np.max(upper - lower))
        obstacles = self._figure.obstacles.values()
        clipped = (points.clip(lower - margin, upper + margin) for points, _ in obstacles)
        near = np.concatenate([[lower, upper], *clipped])
        self._place_camera(near.min(axis=0), near.max(axis=0), np.array([math.cos(azimuth), math.sin(azimuth), 0.6]))
