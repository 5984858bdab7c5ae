"""The common part of the drawings of maps and arms on a page."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cspace import BLOCKED, FREE, MIXED
from cspace.errors import ConfigurationError
from cspace.inside import Floats, Surface
from cspace.plot.scene import PATH_COLOR, Route
from cspace.view._blocks import hex_to_rgb

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

    from cspace.view._tool import ToolFrame

FIELD_OF_VIEW: Final = math.radians(40.0)
"""Vertical field of view of the camera, radians."""

STATES: Final = {
    FREE: "**FREE**: proven collision-free",
    MIXED: "**MIXED**: neither is proven",
    BLOCKED: "**BLOCKED**: proven in collision",
}
"""Text for the states of a configuration."""


class Dial(NamedTuple):
    """A slider that sets one coordinate of a configuration.

    Attributes
    ----------
    label : str
        Name and unit.
    low, high, step : float
        Limits and step, in the unit of the label.
    """

    label: str
    low: float
    high: float
    step: float


class Canvas:
    """Draw a space with the robot, its path, start and goal.

    MapCanvas and ArmCanvas add the other methods that a page calls.

    Parameters
    ----------
    server : viser.ViserServer
    space : ConfigurationSpace
    endpoints : dict of str to ndarray of float64, shape (size,)
        Initial start and goal.

    Attributes
    ----------
    robot : ndarray of float64, shape (size,)
        Configuration of the robot.
    dials : list of Dial
        Coordinates that set a configuration.
    title, about : str
        Description of the space.
    legend : list of tuple of str
        Meanings and their colours.
    tool : ToolFrame or None
        Frame of an arm that users drag to a pose.
    robot_reach : float
        Distance of a rigid robot's farthest point from its reference point, metres; 0 for an arm.
    """

    robot: Floats
    dials: list[Dial]
    title: str
    about: str
    legend: list[tuple[str, str]]
    robot_reach = 0.0
    tool: ToolFrame | None = None
    _path_positions: Callable[[Floats], Floats]

    def __init__(self, server: ViserServer, space: Any, endpoints: dict[str, Floats]) -> None:
        """Light the scene of a server."""
        self._server = server
        self._space = space
        self.endpoints = endpoints
        scene = server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light/ambient", intensity=1.6)
        scene.add_light_directional("/light/main", intensity=1.3, position=(-0.4, -0.7, 1.0))
        scene.add_light_directional("/light/fill", intensity=0.5, position=(0.8, 0.3, 0.6))

    # ---- configurations --------------------------------------------------------------------------

    def interpolate(self, points: Floats, shares: Floats) -> Floats:
        """Interpolate a path at shares of its length; shape (n, size)."""
        return Route(self._space, points).interpolate(shares, self.robot_reach)

    # ---- robot, endpoints and path ---------------------------------------------------------------

    def reach(self) -> str:
        """Move an arm to its tool frame; return the reason if impossible.

        A map has no tool frame.
        """
        return ""

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:
        """Register a callback for drags of endpoints, if any."""

    def draw_path(self, points: Floats) -> None:
        """Draw a path; without points, remove it."""
        if not len(points):
            self._server.scene.remove_by_name("/path")
            return
        shares = np.linspace(0.0, 1.0, 400)
        curve = self._path_positions(self.interpolate(points, shares))
        self._draw_line("/path", curve, PATH_COLOR, thickness=6.0)

    def _draw_line(self, name: str, points: Floats, color: str, thickness: float) -> None:
        """Draw a line through points (n, 3), with thickness in pixels."""
        segments = np.stack([points[:-1], points[1:]], axis=1)
        self._server.scene.add_line_segments(
            name, segments, hex_to_rgb(color), thickness=thickness, thickness_units="screen"
        )

    # ---- changes of the view and of the space ----------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add inputs that choose what is drawn, by their labels."""
        return {}

    def draw(self) -> None:
        """Redraw the cells at the robot's rotation; an arm has none."""

    # ---- drawing ---------------------------------------------------------------------------------

    def _add_mesh(self, name: str, surface: Surface, color: str, opacity: float = 1.0) -> Any:
        """Add a mesh to the scene; return its handle."""
        return self._server.scene.add_mesh_simple(
            name,
            *surface,
            color=hex_to_rgb(color),
            opacity=None if opacity == 1.0 else opacity,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _place_camera(self, lower: Floats, upper: Floats, back: Floats) -> None:
        """Place the initial camera so that a box is in view.

        The camera is in the direction ``back`` from the box.
        """
        center = (lower + upper) / 2
        corners = np.array(list(product(*np.stack([lower, upper], axis=1)))) - center
        # The axes of the camera, which looks along -back.
        back = back / np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        up = np.cross(back, right)

        def measure_distance(aspect: float) -> float:
            """Return the distance from which all corners are in view on a page."""
            offsets = np.maximum(np.abs(corners @ right) / aspect, np.abs(corners @ up))
            distances = offsets / math.tan(FIELD_OF_VIEW / 2.0) + corners @ back
            return 1.1 * float(distances.max())

        distance = measure_distance(1.2)
        camera = self._server.initial_camera
        camera.fov = FIELD_OF_VIEW
        camera.near = 1e-3 * distance
        camera.far = 1e2 * distance
        camera.up = (0.0, 0.0, 1.0)
        camera.look_at = center
        camera.position = center + distance * back

        @self._server.on_client_connect
        def step_back(client: Any) -> None:
            """Move the camera of a narrow page, as of a phone, until all is in view."""
            aspect = client.camera.aspect
            if aspect < 1.2:
                client.camera.position = center + measure_distance(aspect) * back
                client.camera.look_at = center  # which moves with the position


def choose_endpoints(space: Any, fallback: Floats) -> dict[str, Floats]:
    """Choose distant FREE configurations as start and goal, repeatably.

    Without a FREE configuration, both are ``fallback``.
    """
    try:
        q = np.asarray(space.sample_free(64, np.random.default_rng(0)))
    except ConfigurationError:
        q = fallback[np.newaxis]
    positions = q[:, : space.dim]
    distances = np.linalg.norm(positions[:, np.newaxis] - positions, axis=-1)
    start, goal = np.unravel_index(int(distances.argmax()), distances.shape)
    return {"start": q[start], "goal": q[goal]}
