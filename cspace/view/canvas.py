"""Canvas: the base class of the drawings of configuration spaces on a page."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cspace.errors import ConfigurationError
from cspace.plot.artists import GOAL_COLOR, PATH_COLOR
from cspace.support.arrays import BLOCKED, FREE, MIXED, Floats, Surface
from cspace.view.scene import rgb

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

    from cspace.view.tool import ToolFrame

MARKS: Final = {"start": "#ffffff", "goal": GOAL_COLOR}
"""Colours of the marked configurations."""
PATH_POINTS: Final = 400
"""Number of points at which a path is drawn."""
FIELD_OF_VIEW: Final = math.radians(40.0)
"""Vertical field of view of the camera, radians."""
_SAMPLES: Final = 64
"""Number of random configurations from which the first start and goal are chosen."""

STATES: Final = {
    FREE: "**FREE**: proven collision-free",
    MIXED: "**MIXED**: neither is proven",
    BLOCKED: "**BLOCKED**: proven in collision",
}
"""Text for the states of a configuration."""


class Dial(NamedTuple):
    """A coordinate of a configuration as users set it.

    Attributes
    ----------
    label : str
        Name and unit.
    low, high, step : float
        Limits and step, in that unit.
    """

    label: str
    low: float
    high: float
    step: float


class Canvas(ABC):
    """Draw a space with the robot, its path, start and goal.

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
    unit : str
        Unit of :meth:`distance`.
    distance_name : str
        Name of :meth:`distance`: "clearance", or "obstacle distance" of an arm.
    legend : list of tuple of str
        Colours and their meanings.
    has_cells : bool
        True for maps, whose MIXED cells an exact check may decide.
    tool : ToolFrame or None
        Frame of an arm that users drag to a pose.
    bytes : int
        Size of the arrays sent so far to each client.
    """

    robot: Floats
    dials: list[Dial]
    title: str
    about: str
    unit = "m"
    distance_name = "clearance"
    legend: list[tuple[str, str]]
    has_cells = True
    tool: ToolFrame | None = None

    def __init__(self, server: ViserServer, space: Any, endpoints: dict[str, Floats]) -> None:
        self._server, self._space, self.endpoints = server, space, endpoints
        self.bytes = 0
        scene = server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light/ambient", intensity=1.6)
        for position, intensity in (((-0.4, -0.7, 1.0), 1.3), ((0.8, 0.3, 0.6), 0.5)):
            scene.add_light_directional(
                f"/light/{intensity}", intensity=intensity, position=position
            )

    # ---- configurations --------------------------------------------------------------------------

    @abstractmethod
    def dial_values(self, q: Floats) -> tuple[float, ...]:
        """Return the values of the dials at a configuration."""

    @abstractmethod
    def configuration_of(self, numbers: tuple[float, ...]) -> Floats:
        """Return the configuration with these values of the dials."""

    @abstractmethod
    def interpolate(self, points: Floats, shares: Floats) -> Floats:
        """Interpolate a path at shares, 0 to 1, of its length.

        The result has shape (n, size).
        """

    def distance(self, q: Floats) -> Any:
        """Return the distance called :attr:`distance_name` at configurations.

        NaN if it is unknown.
        """
        try:
            return self._space.clearance(q)
        except ConfigurationError:  # a tiled map lacks clearances at some configurations
            return np.full(q.shape[:-1], math.nan)

    def describe(self, q: Floats) -> str:
        """Return state and distance of a configuration as text.

        May also draw them.
        """
        return state_text(
            int(self._space.classify(q)), float(self.distance(q)), self.unit, self.distance_name
        )

    @abstractmethod
    def prove(self, q0: Floats, q1: Floats) -> str:
        """Return the proofs about two configurations as text before a search."""

    # ---- robot, marks and path -------------------------------------------------------------------

    @abstractmethod
    def place(self, q: Floats) -> None:
        """Move the robot."""

    def reach(self) -> str:
        """Move an arm to the pose of its :attr:`tool`; return the reason if it cannot."""
        return ""

    @abstractmethod
    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:  # noqa: B027
        """Call ``moved`` when a user drags the start or the goal."""

    def draw_path(self, points: Floats) -> None:
        """Draw a path; without points, remove it."""
        if not len(points):
            self._server.scene.remove_by_name("/path")
            return
        q = self.interpolate(points, np.linspace(0.0, 1.0, PATH_POINTS))
        self._draw_line("/path", self._path_positions(q), PATH_COLOR, 6.0)

    def _draw_line(self, name: str, points: Floats, color: str, thickness: float) -> None:
        """Draw a line through points, shape (n, 3); its thickness is in pixels."""
        segments = np.stack([points[:-1], points[1:]], axis=1)
        linear = to_linear_rgb(color)
        self._server.scene.add_line_segments(
            name, segments, linear, thickness=thickness, thickness_units="screen"
        )

    @abstractmethod
    def _path_positions(self, q: Floats) -> Floats:
        """Return the points that represent configurations of a path, shape (n, 3)."""

    # ---- changes of the view and of the space ----------------------------------------------------

    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add inputs that choose what is drawn and call ``changed``.

        Return them by label.
        """
        return {}

    def draw(self) -> None:  # noqa: B027
        """Draw everything that depends on the robot's configuration."""

    def invalidate(self) -> None:  # noqa: B027
        """Make :meth:`draw` redraw everything, because the space has changed."""

    # ---- drawing ---------------------------------------------------------------------------------

    def _add_mesh(self, name: str, surface: Surface, color: str, opacity: float = 1.0) -> Any:
        """Add a mesh to the scene, and return its handle."""
        handle = self._server.scene.add_mesh_simple(
            name,
            *surface,
            color=rgb(color),
            opacity=None if opacity == 1.0 else opacity,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )
        self.bytes += handle.vertices.nbytes + handle.faces.nbytes
        return handle

    def _place_camera(self, lower: Floats, upper: Floats, back: Floats) -> None:
        """Place initial cameras so that a box is in view."""
        center, half, back = (lower + upper) / 2, (upper - lower) / 2, back / np.linalg.norm(back)
        right = np.cross([0.0, 0.0, 1.0], back)
        right /= np.linalg.norm(right)
        corners = half * np.array(list(product((-1.0, 1.0), repeat=3)))
        across = np.maximum(np.abs(corners @ right) / 1.2, np.abs(corners @ np.cross(back, right)))
        distance = 1.1 * float(np.max(across / math.tan(FIELD_OF_VIEW / 2.0) + corners @ back))
        camera = self._server.initial_camera
        camera.fov = FIELD_OF_VIEW
        camera.near, camera.far = 1e-3 * distance, 1e2 * distance
        camera.up = (0.0, 0.0, 1.0)
        camera.look_at = center
        camera.position = center + distance * back


def state_text(state: int, distance: float, unit: str, name: str) -> str:
    """Return the state and named distance of a configuration as text."""
    return STATES[state] + (
        f", {name} at least {distance:.3f} {unit}" if 0.0 < distance < math.inf else ""
    )


def sample_free_configurations(space: Any, fallback: Floats) -> Floats:
    """Return FREE configurations, the same at each call, or ``fallback``.

    Shape (n, size).
    """
    try:
        return np.asarray(space.sample_free(_SAMPLES, np.random.default_rng(0)))
    except ConfigurationError:
        return fallback[np.newaxis]


def farthest_pair(q: Floats, positions: Floats) -> dict[str, Floats]:
    """Return the configurations with the most distant positions as start and goal."""
    distances = np.linalg.norm(positions[:, np.newaxis] - positions, axis=-1)
    return dict(
        zip(MARKS, q[list(np.unravel_index(int(distances.argmax()), distances.shape))], strict=True)
    )


def to_linear_rgb(color: str) -> tuple[int, int, int]:
    """Convert an sRGB colour to a linear one, as viser's lines need (IEC 61966-2-1)."""
    shares = (channel / 255.0 for channel in rgb(color))
    red, green, blue = (
        round(255.0 * (share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4))
        for share in shares
    )
    return red, green, blue
