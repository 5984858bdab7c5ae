"""The canvas of an arm: its links and the obstacles as they are, and what is nearest to touching."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.arrays import BLOCKED, FREE, MIXED, Floats
from cspace.errors import InputError
from cspace.plot.arms import ROOM, ArmFigure, along_joints
from cspace.plot.artists import CLASSES, COLLIDES, UNDECIDED
from cspace.rotations.base import TWO_PI, wrapped
from cspace.view.canvas import MARKS, Canvas, Dial, as_light, far_apart, samples, state_text
from cspace.view.scene import KINDS, ROBOT, rgb

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

COLORS: Final = {FREE: ROBOT, MIXED: CLASSES[UNDECIDED][1], BLOCKED: CLASSES[COLLIDES][1]}
"""Of the arm, by its state."""
CONTACT: Final = "#262626"
"""Colour of the line between what is nearest to touching."""
FAINT: Final = 0.35
"""Opacity of the arm at the start and the goal."""
_TENTH: Final = 0.1
"""Degrees that a slider goes in a step."""
_MILLIMETRE: Final = 1e-3


class ArmCanvas(Canvas):
    """Draws an arm among obstacles, its path, the start and the goal.

    ``points`` are a path that is to be seen, shape (n, dof), and ``marks`` the start and the goal, where they are
    given.
    """

    has_cells = False
    distance_name = "obstacle distance"

    def __init__(self, space: Any, server: ViserServer, points: Floats, marks: dict[str, Floats]) -> None:
        given = {name: space._check_configurations(q, name) for name, q in marks.items()}
        drawn = samples(space, np.zeros(space.size).clip(space.arm.lower, space.arm.upper))
        super().__init__(server, space, far_apart(drawn, drawn) | given)
        space._check_configurations(points, "path")
        arm = space.arm
        self._figure = ArmFigure(space)
        self.title = arm.name
        counts = {"joint": arm.dof, "link": len(arm.links), "obstacle": len(space.obstacles)}
        self.about = ", ".join(f"{count} {name}{'s' * (count != 1)}" for name, count in counts.items())
        self._scale = np.array([1.0 if unit == "m" else math.degrees(1.0) for unit in arm.units])
        steps = np.where(self._scale == 1.0, _MILLIMETRE, _TENTH)
        turn = np.where(space.periodic_axes, math.pi, TWO_PI)
        lower = np.ceil(np.where(np.isinf(arm.lower), -turn, arm.lower) * self._scale / steps - 1e-6) * steps
        upper = np.floor(np.where(np.isinf(arm.upper), turn, arm.upper) * self._scale / steps + 1e-6) * steps
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
        self.legend = [(ROBOT, "arm, FREE"), (COLORS[MIXED], "arm, undecided (MIXED)")]
        self.legend += [(COLORS[BLOCKED], "arm, BLOCKED"), (KINDS["obstacles"].color, "obstacle")]
        self.legend += [(CONTACT, "nearest to touching")]
        for name, surface in self._figure.obstacles.items():
            self._mesh(f"/obstacles/{name}", surface, KINDS["obstacles"].color)
        self._links = {"robot": self._meshes("robot", self._figure.links, ROBOT, 1.0)}
        self._links |= {name: self._meshes(name, self._figure.moving, color, FAINT) for name, color in MARKS.items()}
        self._labels = {name: server.scene.add_label(f"/{name}/label", name) for name in MARKS}
        self._look_from_afar()

    # ---- configurations ----------------------------------------------------------------------------------------------

    def numbers(self, q: Floats) -> tuple[float, ...]:
        turned = wrapped(q, self._space.periodic_axes)
        return tuple(np.round(turned * self._scale, 3).tolist())

    def of(self, numbers: tuple[float, ...]) -> Floats:
        arm = self._space.arm
        return np.asarray(np.clip(np.array(numbers) / self._scale, arm.lower, arm.upper))

    def along(self, points: Floats, shares: Floats) -> Floats:
        return along_joints(points, shares)

    def distance(self, q: Floats) -> Any:
        return self._space.obstacle_distance(q)

    def describe(self, q: Floats) -> str:
        """As :meth:`Canvas.describe`; the arm is coloured by its state, and what is nearest to touching is drawn."""
        state = int(self._space.classify(q))
        for link in self._links["robot"].values():
            link.color = rgb(COLORS[state])
        try:
            contact = self._space.closest(q)
        except InputError:  # there is nothing to touch
            return state_text(state, math.inf, self.unit, self.distance_name)
        self._server.scene.add_line_segments(
            "/contact",
            contact.points[np.newaxis],
            np.broadcast_to(as_light(np.array(rgb(CONTACT), dtype=np.uint8)), (1, 2, 3)),
            thickness=4.0,
            thickness_units="screen",
        )
        text = state_text(state, contact.distance, self.unit, self.distance_name)
        return f"{text}  \nnearest to touching: {contact.link} and {contact.other}"

    def prove(self, q0: Floats, q1: Floats) -> str:
        free = self._space.motion_is_free(q0, q1)
        return "**The straight motion is free: proven.**" if free else "The straight motion is not proven free."

    # ---- what is drawn -----------------------------------------------------------------------------------------------

    def place(self, q: Floats) -> None:
        self.robot = q
        self._put("robot", q)

    def mark(self, name: str, q: Floats) -> None:
        self._put(name, q)
        self._labels[name].position = self._figure.tips(q[np.newaxis])[0]

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        box = gui.add_checkbox("start and goal", True)

        def ticked(event: Any) -> None:
            for name in MARKS:
                for link in (*self._links[name].values(), self._labels[name]):
                    link.visible = event.target.value

        box.on_update(ticked)
        return {"start and goal": box}

    def _traced(self, q: Floats) -> Floats:
        return self._figure.tips(q)

    def _meshes(self, name: str, links: Iterable[str], color: str, opacity: float) -> dict[str, Any]:
        return {link: self._mesh(f"/{name}/{link}", self._figure.links[link], color, opacity) for link in links}

    def _put(self, name: str, q: Floats) -> None:
        poses = self._space.arm.poses(q)
        with self._server.atomic():
            for link, handle in self._links[name].items():
                handle.position = poses[link][:3, 3]
                handle.wxyz = Rotation.from_matrix(poses[link][:3, :3]).as_quat(scalar_first=True)

    def _look_from_afar(self) -> None:
        """Place the camera so that the arm is in view, before the obstacles around it."""
        arms = [points for q in self.endpoints.values() for points, _ in self._figure.placed(q).values()]
        lower, upper = np.min([points.min(axis=0) for points in arms], 0), np.max([p.max(axis=0) for p in arms], 0)
        turn, room = self._figure.front(lower, upper), ROOM * float(np.max(upper - lower))
        obstacles = self._figure.obstacles.values()
        near = np.concatenate([[lower, upper], *(points.clip(lower - room, upper + room) for points, _ in obstacles)])
        self._place_camera(near.min(axis=0), near.max(axis=0), np.array([math.cos(turn), math.sin(turn), 0.6]))
