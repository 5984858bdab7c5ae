"""The panel of a page: sliders, start and goal, plans and what they prove in words."""

from __future__ import annotations

import html
import logging
import math
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import ConfigurationError, CspaceError, MissingPackageError
from cspace.plot.artists import CLASSES, COLLIDES, OBSTACLE, OPEN, UNDECIDED
from cspace.plot.route import Floats
from cspace.states import BLOCKED, FREE, MIXED
from cspace.view.canvas import MARKS, Canvas
from cspace.view.scene import HIGH, KINDS, LOW, ROBOT, SECTION
from cspace.view.worker import Worker

if TYPE_CHECKING:
    from viser import ViserServer

    from planners import Plan

LOGGER: Final = logging.getLogger(__name__)

STATES: Final = {
    FREE: "**FREE**: proven collision-free",
    MIXED: "**MIXED**: not decided at this resolution",
    BLOCKED: "**BLOCKED**: proven in collision",
}
EXISTS: Final = {
    True: "**A path exists: proven.**",
    False: "**No path exists: proven.**",
    None: "Whether a path exists is not decided at this resolution.",
}
"""What a map can say, in words."""

AUTOMATIC: Final = "automatic"
"""What a page calls the planner that is taken where none is named."""
SECONDS: Final = 8.0
"""How long a path is played."""
FRAMES: Final = 25.0
"""Pictures of it in a second, at most."""


class Page:
    """What a page says and is told.

    Parameters
    ----------
    server : viser.ViserServer
    space : CSpace or TiledCSpace
    canvas : Canvas
    ends : dict of str to ndarray of float64, shape (dof,)
        Where the start and the goal are at first.
    path : ndarray of float64, shape (n, dof)
        A path to show; n is 0 where there is none.

    Attributes
    ----------
    marks : dict of str to ndarray of float64, shape (dof,)
        The start and the goal.
    plan : Plan or None
        What the last search found.
    """

    def __init__(self, server: ViserServer, space: Any, canvas: Canvas, ends: dict[str, Floats], path: Floats) -> None:
        self._space, self._canvas, self._gui = space, canvas, server.gui
        self.marks, self.plan = dict(ends), None  # type: dict[str, Floats], Plan | None
        self._path, self._proves = path, canvas.cells.quick
        self._playing = threading.Event()
        self._drawer = Worker(canvas.draw, self._fail)
        self._teller = Worker(self._tell, self._fail)
        self._prover = Worker(self._prove, self._fail)
        self._planner = Worker(self._search, self._fail)
        self._player = Worker(self._play, self._fail)
        step = 10.0 ** math.floor(math.log10(space.grid.spacing))
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, control_width="large", brand_color=(0, 114, 178)
        )
        server.gui.main_panel.dock_right()
        self._gui.add_markdown(f"**{space.robot.name}**  \n{_about(space)}")
        with self._gui.add_folder("Plan"):
            self._add_plan(step)
        with self._gui.add_folder("Path"):
            self._add_path()
        with self._gui.add_folder("Robot"):
            self._add_robot(step)
        with self._gui.add_folder("Show"):
            self._add_show(step)
        for name in MARKS:
            canvas.on_drag(name, partial(self._marked, name))
            self.mark(name, ends[name])
        self._follow(path)
        self.move(ends["start"])
        server.on_client_connect(self._watch)

    # ---- what programs do --------------------------------------------------------------------------------------------

    def move(self, q: Floats) -> None:
        """Bring the robot to a configuration, and show the cells at its rotation."""
        self._canvas.place(q)
        numbers = (*self._canvas.poses.position(q), *self._canvas.poses.degrees(q))
        for slider, number in zip(self._sliders, numbers, strict=True):
            slider.value = min(max(number, slider.min), slider.max)
        self._drawer.ask()
        self._teller.ask()

    def mark(self, name: str, q: Floats) -> None:
        """Bring the start or the goal to a configuration."""
        self._canvas.mark(name, q)
        self._marked(name, q)

    def _marked(self, name: str, q: Floats) -> None:
        """Take note of where the start or the goal is."""
        self.marks[name] = q
        position, degrees = self._inputs[name]
        position.value = tuple(np.round(self._canvas.poses.position(q), 3).tolist())
        if degrees is not None:
            degrees.value = _as_value(tuple(np.round(self._canvas.poses.degrees(q), 2).tolist()))
        self._answer.content = ""  # it was about other ones
        self._prover.ask()

    def refresh(self) -> None:
        """Draw and prove anew: the map has changed."""
        self._canvas.forget()
        for worker in (self._drawer, self._teller, self._prover):
            worker.ask()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until all is drawn and said that was asked for; whether it is."""
        return all(each.wait(seconds) for each in (self._planner, self._drawer, self._teller, self._prover))

    def close(self) -> None:
        """End all threads."""
        self._playing.clear()
        for worker in (self._drawer, self._teller, self._prover, self._planner, self._player):
            worker.close()

    # ---- the panel ---------------------------------------------------------------------------------------------------

    def _add_plan(self, step: float) -> None:
        gui, poses = self._gui, self._canvas.poses
        self._inputs: dict[str, tuple[Any, Any]] = {}
        axes = ", ".join("xyz"[: self._space.grid.dim])
        for name, q in self.marks.items():
            hint = f"Or drag the {name} in the scene."
            position = _numbers(gui, f"{name}: {axes} (m)", poses.position(q), step, hint)
            degrees = None
            if poses.angles:
                degrees = _numbers(gui, f"{name}: {', '.join(poses.angles)} (°)", poses.degrees(q), 1.0, hint)
            self._inputs[name] = position, degrees

            def typed(event: Any, name: str = name) -> None:
                if event.client is not None:
                    position, degrees = (() if each is None else _as_tuple(each.value) for each in self._inputs[name])
                    self.mark(name, poses.of(position, degrees))

            for handle in self._inputs[name]:
                if handle is not None:
                    handle.on_update(typed)
        names, drives, curves = _choices(self._space)
        self._planner_name = gui.add_dropdown("planner", names, hint="Of OMPL; Cubes and Widest are the map's.")
        self._drive = gui.add_dropdown("drive", drives, hint="How the robot moves.", visible=len(drives) > 1)
        self._radius = gui.add_number("turning radius (m)", 1.0, min=0.01, step=0.05, visible=False)

        def chosen(_: Any) -> None:
            self._radius.visible = self._drive.value in curves

        self._drive.on_update(chosen)
        self._limit = gui.add_number("time limit (s)", 1.0, min=0.1, max=3600.0, step=0.5)
        self._exact = gui.add_checkbox(
            "exact", False, hint="Ask the geometry itself where the grid cannot decide; slower."
        )
        self._button = gui.add_button("Plan")
        self._button.on_click(lambda _: self._planner.ask())
        self._proof = gui.add_markdown("Finding out which cells are joined …" if self._proves else "")
        self._answer = gui.add_markdown("")

    def _add_path(self) -> None:
        gui = self._gui
        self._share: Any = gui.add_slider("along it (%)", 0.0, 100.0, 0.1, 0.0)
        self._play_button = gui.add_button("Play")
        self._scale = gui.add_html("")

        def pulled(event: Any) -> None:
            if event.client is not None and len(self._path):
                self._playing.clear()
                self._go(self._share.value / 100.0)

        def pressed(_: Any) -> None:
            if self._playing.is_set():
                self._playing.clear()
            else:
                self._playing.set()
                self._player.ask()

        self._share.on_update(pulled)
        self._play_button.on_click(pressed)

    def _add_robot(self, step: float) -> None:
        gui, grid, poses = self._gui, self._space.grid, self._canvas.poses
        self._sliders: list[Any] = [
            gui.add_slider(f"{axis} (m)", _down(low, step), _up(high, step), step, _down(low, step))
            for axis, low, high in zip("xyz", grid.lower, grid.upper, strict=False)
        ]
        self._sliders += [
            gui.add_slider(f"{angle} (°)", *((-90.0, 90.0) if angle == "pitch" else (-180.0, 180.0)), 1.0, 0.0)
            for angle in poses.angles
        ]
        self._state = gui.add_markdown("")

        def pulled(event: Any) -> None:
            if event.client is None:
                return
            self._playing.clear()
            numbers = tuple(float(slider.value) for slider in self._sliders)
            q = poses.of(numbers[: grid.dim], numbers[grid.dim :])
            self._canvas.place(q)
            self._drawer.ask()
            self._teller.ask()

        for slider in self._sliders:
            slider.on_update(pulled)

    def _add_show(self, step: float) -> None:
        gui, canvas = self._gui, self._canvas
        if canvas.stage.has_height:
            low, high = canvas.stage.lower[2] + self._space.grid.spacing, canvas.stage.upper[2]
            low, high = _up(low, step), _up(high, step)
            canvas.cut = min(max(_up(canvas.cut, step), low), high)
            cut = gui.add_slider("cut at height (m)", low, high, step, canvas.cut)

            def pulled(event: Any) -> None:
                canvas.cut = float(event.target.value)
                self._drawer.ask()

            cut.on_update(pulled)
        labels = {name: kind.label for name, kind in KINDS.items()} | {
            SECTION: "section" if canvas.stage.has_height else "ground"
        }
        for name, label in labels.items():
            box = gui.add_checkbox(label, name in canvas.shown)

            def ticked(event: Any, name: str = name) -> None:
                (canvas.shown.add if event.target.value else canvas.shown.discard)(name)
                self._drawer.ask()

            box.on_update(ticked)
        gui.add_html(_legend())

    # ---- what is done in threads -------------------------------------------------------------------------------------

    def _tell(self) -> None:
        """Say what is known of where the robot is."""
        q = self._canvas.robot
        words = STATES[int(self._space.classify(q))]
        clearance = self._clearance(q)
        if np.isfinite(clearance) and clearance > 0.0:
            words += f", clearance at least {clearance:.3f} m"
        self._state.content = f"{words}  \n{self._space.rotations.about(q[self._space.grid.dim :])}"

    def _prove(self) -> None:
        """Say whether a path joins start and goal."""
        if self._proves:
            self._proof.content = EXISTS[self._space.path_exists(self.marks["start"], self.marks["goal"])]

    def _search(self) -> None:
        """Plan, and say what came out."""
        import planners

        self._answer.content = "Planning …"
        self._button.disabled = True
        try:
            self.plan = found = planners.plan(
                self._space,
                self.marks["start"],
                self.marks["goal"],
                planner=None if self._planner_name.value == AUTOMATIC else self._planner_name.value,
                time_limit=float(self._limit.value),
                exact=bool(self._exact.value),
                drive=self._drive.value,
                turning_radius=float(self._radius.value) if self._radius.visible else None,
            )
        finally:
            self._button.disabled = False
        self._proves = True  # what the cells join is known from here on
        self._prover.ask()
        self._answer.content = _in_words(found)
        self._follow(found.path)
        if found.solved:
            self.move(found.path[0])

    def _play(self) -> None:
        """Move the robot along the path, until it is there or someone stops it."""
        self._play_button.label = "Stop"
        share = self._share.value / 100.0 if self._share.value < 100.0 else 0.0
        began = time.perf_counter() - share * SECONDS
        try:
            while self._playing.is_set() and share < 1.0 and len(self._path):
                share = min(1.0, (time.perf_counter() - began) / SECONDS)
                self._share.value = round(100.0 * share, 1)
                self._go(share)
                time.sleep(1.0 / FRAMES)
        finally:
            self._playing.clear()
            self._play_button.label = "Play"

    def _go(self, share: float) -> None:
        self.move(self._canvas.figurine.along(self._path, np.array([share]))[0])

    def _follow(self, path: Floats) -> None:
        """Show a path."""
        self._playing.clear()
        self._path = path
        most = self._canvas.follow(path, self._clearance)
        self._share.value = 0.0
        self._share.disabled = self._play_button.disabled = not len(path)
        self._scale.content = _scale(most) if len(path) else _note("Plan one, or open the page with a path.")

    def _clearance(self, q: Floats) -> Any:
        try:
            return self._space.clearance(q)
        except ConfigurationError:  # a map in a store does not tell
            return np.full(q.shape[:-1], math.nan)

    def _watch(self, client: Any) -> None:
        """Draw what a client looks at in smaller blocks."""

        def looked(camera: Any) -> None:
            if self._canvas.look(camera.look_at, camera.position, camera.fov, camera.aspect):
                self._drawer.ask()

        client.camera.on_update(looked)

    def _fail(self, error: Exception) -> None:
        """Say what went wrong; the page goes on."""
        if not isinstance(error, CspaceError):
            LOGGER.error("the page met an error", exc_info=error)
        words = str(error) if isinstance(error, CspaceError) else f"{type(error).__name__}: {error}"
        self._answer.content = f"**Not done:** {words}"


def _about(space: Any) -> str:
    """A map in a line or two."""
    cells = " x ".join(f"{n:,}" for n in space.grid.shape)
    turns = f" x {space.rotations}" if space.rotations.names else ""
    return f"{cells} cells of {space.grid.spacing:g} m{turns}"


def _in_words(found: Plan) -> str:
    """A plan, and what it proves."""
    if not found.solved:
        advice = f"  \nTry {found.advice}." if found.advice else ""
        return f"**{found.status[:1].upper()}{found.status[1:]}.**{advice}"
    proof = "certified: every edge is proven free" if found.certified else "not certified"
    room = "" if math.isnan(found.clearance) else f", clearance at least {found.clearance:.3f} m"
    seconds = found.times.planning + found.times.simplification
    took = f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
    words = f"**{found.status[:1].upper()}{found.status[1:]}**, {proof}."
    return f"{words}  \n{found.length:.3f} m{room}  \n{found.planner}, {took}"


def _choices(space: Any) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Names of planners, of drives, and of drives with a turning radius; the first ones are those to begin with."""
    try:
        import planners
    except MissingPackageError:
        return (AUTOMATIC,), ("holonomic",), ()
    known = planners.local_planner
    names = (AUTOMATIC, *planners.planner_names(), *known.local_planner(space).own)
    return names, known.DRIVES if space.axes == known.CAR_AXES else known.DRIVES[:1], known.CURVES


def _legend() -> str:
    """Colours, and what they mean."""
    cells = [(CLASSES[number][1], CLASSES[number][0]) for number in (OPEN, COLLIDES, UNDECIDED, OBSTACLE)]
    rows = [*cells, (KINDS["obstacles"].color, "obstacle, in the light"), (ROBOT, "robot")]
    rows += [(color, name) for name, color in MARKS.items()]
    square = "display:inline-block;width:0.9em;height:0.9em;margin-right:0.5em;border:1px solid #777;background:"
    items = "".join(
        f'<div style="margin:0.15em 0"><span style="{square}{color}"></span>{html.escape(name)}</div>'
        for color, name in rows
    )
    return f'<div style="font-size:0.8em;padding:0.4em 0.8em">{items}</div>'


def _scale(most: float) -> str:
    """The colours of the path."""
    if math.isnan(most):
        return _note("Of a map in a store, no clearance is told.")
    bar = f"height:0.6em;border-radius:0.3em;background:linear-gradient(to right,{LOW},{HIGH})"
    ends = "display:flex;justify-content:space-between"
    return (
        f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em"><div style="{bar}"></div>'
        f'<div style="{ends}"><span>0</span><span>clearance</span><span>{most:.2g} m</span></div></div>'
    )


def _note(words: str) -> str:
    return f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em;color:#777">{html.escape(words)}</div>'


def _down(value: float, step: float) -> float:
    return round(math.floor(value / step + 1e-9) * step, 9)


def _up(value: float, step: float) -> float:
    return round(math.ceil(value / step - 1e-9) * step, 9)


def _numbers(gui: Any, label: str, values: tuple[float, ...], step: float, hint: str) -> Any:
    """An input of one to three numbers."""
    add = {1: gui.add_number, 2: gui.add_vector2, 3: gui.add_vector3}[len(values)]
    return add(label, _as_value(values), step=step, hint=hint)


def _as_value(numbers: tuple[float, ...]) -> Any:
    """As an input takes numbers: one alone, or several."""
    return numbers if len(numbers) > 1 else numbers[0]


def _as_tuple(value: Any) -> tuple[float, ...]:
    return tuple(np.atleast_1d(value).tolist())
