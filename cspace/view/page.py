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

from cspace.arrays import Floats
from cspace.errors import CspaceError, MissingPackageError
from cspace.view.canvas import MARKS, Canvas
from cspace.view.planning import PlanLike, planning
from cspace.view.scene import HIGH, LOW
from cspace.view.worker import Worker

if TYPE_CHECKING:
    from viser import ViserServer

LOGGER: Final = logging.getLogger(__name__)

AUTOMATIC: Final = "automatic"
"""What a page calls the planner that is taken where none is named."""
SECONDS: Final = 8.0
"""How long a path is played."""
FRAMES: Final = 25.0
"""Pictures of it in a second, at most."""


class Page:
    """The panel of a page: what it shows, and what people set there.

    ``path``, shape (n, dof), is one to show; n is 0 where there is none.

    Attributes
    ----------
    marks : dict of str to ndarray of float64, shape (dof,)
        The start and the goal.
    plan : PlanLike or None
        What the last search found.
    """

    def __init__(self, server: ViserServer, space: Any, canvas: Canvas, path: Floats) -> None:
        self._space, self._canvas, self._gui = space, canvas, server.gui
        self.marks, self.plan = dict(canvas.endpoints), None  # type: dict[str, Floats], PlanLike | None
        self._path, self._proves = path, canvas.is_quick
        self._playing = threading.Event()
        self._drawer = Worker(canvas.draw, self._fail)
        self._describer = Worker(self._describe, self._fail)
        self._prover = Worker(self._prove, self._fail)
        self._planner = Worker(self._search, self._fail)
        self._player = Worker(self._play, self._fail)
        server.gui.configure_theme(
            show_logo=False, show_share_button=False, control_width="large", brand_color=(0, 114, 178)
        )
        server.gui.main_panel.dock_right()
        self._gui.add_markdown(f"**{canvas.title}**  \n{canvas.about}")
        with self._gui.add_folder("Plan"):
            self._add_plan()
        with self._gui.add_folder("Path"):
            self._add_path()
        with self._gui.add_folder("Robot"):
            self._add_robot()
        with self._gui.add_folder("Show"):
            canvas.add_choices(self._gui, self._drawer.request)
            self._gui.add_html(_legend([*canvas.legend, *((color, name) for name, color in MARKS.items())]))
        for name, q in canvas.endpoints.items():
            canvas.on_drag(name, partial(self._marked, name))
            self.mark(name, q)
        self._follow(path)
        self.move(canvas.endpoints["start"])
        server.on_client_connect(self._watch)

    # ---- what programs do --------------------------------------------------------------------------------------------

    def move(self, q: Floats) -> None:
        """Move the robot to a configuration, and show what depends on it."""
        for slider, number in zip(self._sliders, self._canvas.numbers(q), strict=True):
            slider.value = min(max(number, slider.min), slider.max)
        self._place(q)

    def _place(self, q: Floats) -> None:
        self._canvas.place(q)
        self._drawer.request()
        self._describer.request()

    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal to a configuration."""
        self._canvas.mark(name, q)
        self._marked(name, q)

    def _marked(self, name: str, q: Floats) -> None:
        """Note where the start or the goal is."""
        self.marks[name] = q
        numbers = self._canvas.numbers(q)
        for (_, which), handle in zip(self._canvas.typed, self._inputs[name], strict=True):
            handle.value = _as_value(tuple(np.round(numbers[which], 3).tolist()))
        self._answer.content = ""  # it was about other ones
        self._prover.request()

    def refresh(self) -> None:
        """Draw and prove anew: the map has changed."""
        self._canvas.forget()
        for worker in (self._drawer, self._describer, self._prover):
            worker.request()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until all that was requested is drawn and said; gives whether it is."""
        return all(each.wait(seconds) for each in (self._planner, self._drawer, self._describer, self._prover))

    def close(self) -> None:
        """End all threads."""
        self._playing.clear()
        for worker in (self._drawer, self._describer, self._prover, self._planner, self._player):
            worker.close()

    # ---- the panel ---------------------------------------------------------------------------------------------------

    def _add_plan(self) -> None:
        gui, canvas = self._gui, self._canvas
        self._inputs: dict[str, list[Any]] = {}
        for name, q in self.marks.items():
            hint, numbers = f"Or drag the {name} in the scene.", canvas.numbers(q)
            self._inputs[name] = [
                _numbers(gui, f"{name}: {label}", numbers[which], canvas.dials[which][0].step, hint)
                for label, which in canvas.typed
            ]

            def typed(event: Any, name: str = name) -> None:
                if event.client is not None:
                    self.mark(name, canvas.of(tuple(x for each in self._inputs[name] for x in _as_tuple(each.value))))

            for handle in self._inputs[name]:
                handle.on_update(typed)
        names, drives, curves = _choices(self._space)
        self._planner_name = gui.add_dropdown("planner", names, hint="Of OMPL; Cubes and Widest are a map's own.")
        self._drive = gui.add_dropdown("drive", drives, hint="How the robot moves.", visible=len(drives) > 1)
        self._radius = gui.add_number("turning radius (m)", 1.0, min=0.01, step=0.05, visible=False)

        def chosen(_: Any) -> None:
            self._radius.visible = self._drive.value in curves

        self._drive.on_update(chosen)
        self._limit = gui.add_number("time limit (s)", 1.0, min=0.1, max=3600.0, step=0.5)
        self._exact = gui.add_checkbox(
            "exact",
            False,
            hint="Ask the geometry itself where the grid cannot decide; slower.",
            visible=canvas.has_cells,
        )
        self._button = gui.add_button("Plan")
        self._button.on_click(lambda _: self._planner.request())
        self._proof = gui.add_markdown("Finding out what is joined …" if self._proves else "")
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
                self._player.request()

        self._share.on_update(pulled)
        self._play_button.on_click(pressed)

    def _add_robot(self) -> None:
        gui, canvas = self._gui, self._canvas
        numbers = zip(canvas.dials, canvas.numbers(canvas.endpoints["start"]), strict=True)
        self._sliders: list[Any] = [
            gui.add_slider(dial.label, dial.low, dial.high, dial.step, min(max(number, dial.low), dial.high))
            for dial, number in numbers
        ]
        self._state = gui.add_markdown("")
        self._here = gui.add_button_group("make it the", tuple(self.marks))

        def pulled(event: Any) -> None:
            if event.client is not None:
                self._playing.clear()
                self._place(canvas.of(tuple(float(slider.value) for slider in self._sliders)))

        for slider in self._sliders:
            slider.on_update(pulled)
        self._here.on_click(lambda event: self.mark(event.target.value, canvas.robot))

    # ---- what is done in threads -------------------------------------------------------------------------------------

    def _describe(self) -> None:
        """Say what is proven of the robot's configuration."""
        self._state.content = self._canvas.describe(self._canvas.robot)

    def _prove(self) -> None:
        """Say what is proven of start and goal."""
        if self._proves:
            self._proof.content = self._canvas.prove(self.marks["start"], self.marks["goal"])

    def _search(self) -> None:
        """Plan, and say what came out."""
        self._answer.content = "Planning …"
        self._button.disabled = True
        try:
            self.plan = plan = planning().plan(
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
        self._prover.request()
        self._follow(plan.path)
        if plan.solved:
            self.move(plan.path[0])
        self._answer.content = _plan_text(plan)

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
        self.move(self._canvas.along(self._path, np.array([share]))[0])

    def _follow(self, path: Floats) -> None:
        """Show a path, from its start."""
        self._playing.clear()
        self._path = path
        most = self._canvas.follow(path)
        self._share.value = 0.0
        self._share.disabled = self._play_button.disabled = not len(path)
        self._scale.content = _scale(most) if len(path) else _note("Plan one, or open the page with a path.")

    def _watch(self, client: Any) -> None:
        """Draw what a client looks at in smaller blocks."""

        def looked(camera: Any) -> None:
            if self._canvas.look(camera.look_at, camera.position, camera.fov, camera.aspect):
                self._drawer.request()

        client.camera.on_update(looked)

    def _fail(self, error: Exception) -> None:
        """Say what went wrong; the page goes on."""
        if not isinstance(error, CspaceError):
            LOGGER.error("the page met an error", exc_info=error)
        message = str(error) if isinstance(error, CspaceError) else f"{type(error).__name__}: {error}"
        self._answer.content = f"**Not done:** {message}"


def _plan_text(plan: PlanLike) -> str:
    """A plan, and what it proves."""
    if not plan.solved:
        advice = f"  \nTry {plan.advice}." if plan.advice else ""
        return f"**{plan.status[:1].upper()}{plan.status[1:]}.**{advice}"
    proof = "certified: every edge is proven free" if plan.certified else "not certified"
    (name, distance), (unit, distance_unit) = plan.shown_distance, plan.units
    apart = "" if math.isnan(distance) else f", {name.replace('_', ' ')} at least {distance:.3f} {distance_unit}"
    seconds = plan.times.planning + plan.times.simplification
    took = f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
    text = f"**{plan.status[:1].upper()}{plan.status[1:]}**, {proof}."
    return f"{text}  \n{plan.length:.3f} {unit}{apart}  \n{plan.planner}, {took}"


def _choices(space: Any) -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Names of planners, of drives, and of drives with a turning radius; the first ones are those to begin with."""
    try:
        choices = planning().choices(space)
    except MissingPackageError:  # the page shows the map; who plans there is told what is missing
        return (AUTOMATIC,), ("holonomic",), ()
    return (AUTOMATIC, *choices.planners), choices.drives, choices.curves


def _legend(rows: list[tuple[str, str]]) -> str:
    """Colours, and what they mean."""
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
    row = "display:flex;justify-content:space-between"
    return (
        f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em"><div style="{bar}"></div>'
        f'<div style="{row}"><span>0</span><span>clearance</span><span>{most:.2g} m</span></div></div>'
    )


def _note(text: str) -> str:
    return f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em;color:#777">{html.escape(text)}</div>'


def _numbers(gui: Any, label: str, values: tuple[float, ...], step: float, hint: str) -> Any:
    """An input of one to three numbers."""
    add = {1: gui.add_number, 2: gui.add_vector2, 3: gui.add_vector3}[len(values)]
    return add(label, _as_value(values), step=step, hint=hint)


def _as_value(numbers: tuple[float, ...]) -> Any:
    """As an input takes numbers: one alone, or several."""
    return numbers if len(numbers) > 1 else numbers[0]


def _as_tuple(value: Any) -> tuple[float, ...]:
    return tuple(np.atleast_1d(value).tolist())
