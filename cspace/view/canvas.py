"""Canvas: what a page shows of a configuration space, how configurations are set there, and what is said of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import BLOCKED, FREE, MIXED, Floats, Surface
from cspace.errors import ConfigurationError
from cspace.plot.artists import GOAL
from cspace.view.scene import path_colors, rgb

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

MARKS: Final = {"start": "#ffffff", "goal": GOAL}
"""Configurations that are marked, and their colours."""
STATIONS: Final = 400
"""Points of a path that are drawn."""
FIELD: Final = math.radians(40.0)
"""Field of view of the camera, from top to bottom."""
_DRAWN: Final = 64
"""Configurations that are drawn to begin with two that are far apart."""

STATES: Final = {
    FREE: "**FREE**: proven collision-free",
    MIXED: "**MIXED**: neither is proven",
    BLOCKED: "**BLOCKED**: proven in collision",
}
"""The states of a configuration, in words."""


class Dial(NamedTuple):
    """A number of a configuration as people set it.

    Attributes
    ----------
    label : str
        What it is called, and its unit.
    low, high, step : float
    """

    label: str
    low: float
    high: float
    step: float


class Canvas(ABC):
    """Draws a space with the robot, its path, the start and the goal.

    ``endpoints`` are where the start and the goal are at first.

    Attributes
    ----------
    robot : ndarray of float64, shape (size,)
        Where the robot is.
    dials : list of Dial
        What a configuration is set by.
    typed : list of tuple of str and slice
        Those of them that are typed together, at most three, and their names; none where there are too many.
    title, about : str
        The space in a line or two.
    unit : str
        Unit of :meth:`distance`.
    distance_name : str
        The distance that is shown and colours paths: "clearance", or "obstacle distance" of an arm.
    legend : list of tuple of str
        Colours, and what they mean.
    has_cells : bool
        Whether there are cells, in which the geometry itself may decide.
    is_quick : bool
        Whether what is proven of a start and a goal is soon known.
    bytes : int
        Of arrays, sent so far to each client.
    """

    robot: Floats
    dials: list[Dial]
    typed: list[tuple[str, slice]]
    title: str
    about: str
    unit = "m"
    distance_name = "clearance"
    legend: list[tuple[str, str]]
    has_cells = True
    is_quick = True

    def __init__(self, server: ViserServer, space: Any, endpoints: dict[str, Floats]) -> None:
        self._server, self._space, self.endpoints = server, space, endpoints
        self.bytes = 0
        scene = server.scene
        scene.configure_environment_map(None)
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light/ambient", intensity=1.6)
        for place, intensity in (((-0.4, -0.7, 1.0), 1.3), ((0.8, 0.3, 0.6), 0.5)):
            scene.add_light_directional(f"/light/{intensity}", intensity=intensity, position=place)

    # ---- configurations ----------------------------------------------------------------------------------------------

    @abstractmethod
    def numbers(self, q: Floats) -> tuple[float, ...]:
        """What the dials show at a configuration."""

    @abstractmethod
    def of(self, numbers: tuple[float, ...]) -> Floats:
        """The configuration that the dials show."""

    @abstractmethod
    def along(self, points: Floats, shares: Floats) -> Floats:
        """Configurations at shares, from 0 to 1, of the length of a path, shape (n, size)."""

    def distance(self, q: Floats) -> Any:
        """Return the distance called :attr:`distance_name` at configurations; NaN where the space gives none."""
        try:
            return self._space.clearance(q)
        except ConfigurationError:  # a map in a store has none there
            return np.full(q.shape[:-1], math.nan)

    def describe(self, q: Floats) -> str:
        """What is known of a configuration, in words; it may be shown, too."""
        return state_text(int(self._space.classify(q)), float(self.distance(q)), self.unit, self.distance_name)

    @abstractmethod
    def prove(self, q0: Floats, q1: Floats) -> str:
        """What is proven of two configurations before a path is searched, in words."""

    # ---- what stands on its own --------------------------------------------------------------------------------------

    @abstractmethod
    def place(self, q: Floats) -> None:
        """Move the robot."""

    @abstractmethod
    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal."""

    def on_drag(self, name: str, moved: Callable[[Floats], None]) -> None:  # noqa: B027
        """Have ``moved`` called with where the start or the goal is dragged to, if it can be."""

    def follow(self, points: Floats) -> float:
        """Draw a path, coloured by :meth:`distance`; return the largest distance along it."""
        if not len(points):
            self._server.scene.remove_by_name("/path")
            return math.nan
        along = self.along(points, np.linspace(0.0, 1.0, STATIONS))
        values = self.distance(along)
        places, colors = self._traced(along), as_light(path_colors(values))
        self._server.scene.add_line_segments(
            "/path",
            np.stack([places[:-1], places[1:]], axis=1),
            np.stack([colors[:-1], colors[1:]], axis=1),
            thickness=6.0,
            thickness_units="screen",
        )
        return float(np.max(values, initial=0.0, where=np.isfinite(values)))

    @abstractmethod
    def _traced(self, q: Floats) -> Floats:
        """Points by which configurations of a path are drawn, shape (n, 3)."""

    # ---- what changes with the view, and with the space --------------------------------------------------------------

    @abstractmethod
    def add_choices(self, gui: GuiApi, changed: Callable[[], None]) -> dict[str, Any]:
        """Add to a panel what can be chosen to be drawn, by label; ``changed`` is called at each change."""

    def look(self, look_at: Floats, position: Floats, field: float, aspect: float) -> bool:
        """Note where a camera looks; gives whether something must be drawn anew for it."""
        return False

    def draw(self) -> None:  # noqa: B027
        """Draw what depends on the robot's configuration, as it is now."""

    def forget(self) -> None:  # noqa: B027
        """Draw all anew at the next call: the space has changed."""

    # ---- how it is drawn ---------------------------------------------------------------------------------------------

    def _mesh(self, name: str, surface: Surface, color: str, opacity: float = 1.0) -> Any:
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
        """Have cameras begin in some direction from the middle of a box, where all of it is in view."""
        middle, half, back = (lower + upper) / 2, (upper - lower) / 2, back / np.linalg.norm(back)
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


def state_text(state: int, distance: float, unit: str, name: str) -> str:
    """Describe a configuration's state and named distance."""
    return STATES[state] + (f", {name} at least {distance:.3f} {unit}" if 0.0 < distance < math.inf else "")


def samples(space: Any, otherwise: Floats) -> Floats:
    """FREE configurations to begin with two of, the same at each call; of a space that has none, the one given."""
    try:
        return np.asarray(space.sample_free(_DRAWN, np.random.default_rng(0)))
    except ConfigurationError:
        return otherwise[np.newaxis]


def far_apart(drawn: Floats, places: Floats) -> dict[str, Floats]:
    """Those two of configurations whose places, shape (n, d), are farthest apart."""
    apart = np.linalg.norm(places[:, np.newaxis] - places, axis=-1)
    return dict(zip(MARKS, drawn[list(np.unravel_index(int(apart.argmax()), apart.shape))], strict=True))


def as_light(colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Colours as lines take them: in proportion to their light, and not as screens do (IEC 61966-2-1, sRGB)."""
    share = colors / 255.0
    return np.rint(255.0 * np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)).astype(np.uint8)
