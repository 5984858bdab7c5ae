"""A page: the panel with what can be set and what is said, and what it does: move the robot, plan, play and prove."""

from __future__ import annotations

import html
import logging
import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Floats
from cspace.errors import CspaceError, MissingPackageError
from cspace.view.canvas import MARKS, Canvas
from cspace.view.scene import HIGH, LOW

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

    from planners import Choices, Plan

LOGGER: Final = logging.getLogger(__name__)

SECONDS: Final = 8.0
"""How long a path is played."""
FRAMES: Final = 25.0
"""Pictures of it in a second, at most."""
REST: Final = 2.0
"""Between two of them, what a browser has left for people, as a multiple of the time in which it came to the first."""
BEHIND: Final = 0.5
"""Seconds after which a browser that has not come to a picture is waited for no longer."""
AUTOMATIC: Final = "automatic"
"""What a page calls the planner that is taken where none is named."""


class Panel:
    """What can be set on a page, and what is said there: viser's handles.

    What is set has a ``value``, which programs may set, too; what is said has a ``content``. Without ``choices`` there
    is nobody who plans. ``changed`` is called where other things are to be drawn.

    Attributes
    ----------
    planner, drive : GuiDropdownHandle
    turning_radius, time_limit : GuiInputHandle of float
        Metres, seen where the drive needs it; seconds.
    exact : GuiInputHandle of bool
        Whether the geometry itself is asked where cells do not decide.
    plan : GuiButtonHandle
    proof, answer : GuiMarkdownHandle
        What is proven of start and goal, and what the last search found, or what went wrong.
    share : GuiSliderHandle of float
        Where on the path the robot is, percent of its length.
    play : GuiButtonHandle
    sliders : list of GuiSliderHandle of float
        What the robot is moved by, one for each of :attr:`Canvas.dials`.
    state : GuiMarkdownHandle
        What is proven of the robot's configuration.
    make_it : GuiButtonGroupHandle
        Makes it the start or the goal.
    shown : dict of str to GuiInputHandle
        What can be chosen to be drawn, by its label.
    """

    def __init__(self, gui: GuiApi, canvas: Canvas, choices: Choices | None, changed: Callable[[], None]) -> None:
        self._gui, self._canvas = gui, canvas
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large", brand_color=(0, 114, 178))
        gui.main_panel.dock_right()
        gui.add_markdown(f"**{canvas.title}**  \n{canvas.about}")
        self._typed: dict[str, list[Any]] = {}
        with gui.add_folder("Plan"):
            for name, q in canvas.endpoints.items():
                self._typed[name] = self._add_typed(name, canvas.numbers(q))
            self._add_plan(choices)
        with gui.add_folder("Path"):
            self.share: Any = gui.add_slider("along it (%)", 0.0, 100.0, 0.1, 0.0)
            self.play = gui.add_button("Play")
            self.scale = gui.add_html("")
        with gui.add_folder("Robot"):
            self.sliders: list[Any] = [
                gui.add_slider(dial.label, dial.low, dial.high, dial.step, dial.low) for dial in canvas.dials
            ]
            self.state = gui.add_markdown("")
            self.make_it = gui.add_button_group("make it the", tuple(canvas.endpoints))
        with gui.add_folder("Show"):
            self.shown = canvas.add_choices(gui, changed)
            gui.add_html(_legend([*canvas.legend, *((color, name) for name, color in MARKS.items())]))

    def _add_typed(self, name: str, numbers: tuple[float, ...]) -> list[Any]:
        """Inputs of one to three numbers each."""
        add: dict[int, Callable[..., Any]] = {
            1: self._gui.add_number,
            2: self._gui.add_vector2,
            3: self._gui.add_vector3,
        }
        hint = f"Or drag the {name} in the scene."
        return [
            add[len(numbers[which])](
                f"{name}: {label}", _as_value(numbers[which]), step=self._canvas.dials[which][0].step, hint=hint
            )
            for label, which in self._canvas.typed
        ]

    def _add_plan(self, choices: Choices | None) -> None:
        gui, canvas = self._gui, self._canvas
        planners, drives = (choices.planners, choices.drives) if choices else ((), ("holonomic",))
        self.planner = gui.add_dropdown(
            "planner", (AUTOMATIC, *planners), hint="Of OMPL; Grid and MaxClearance are a map's own."
        )
        self.drive = gui.add_dropdown("drive", drives, hint="How the robot moves.", visible=len(drives) > 1)
        self.turning_radius = gui.add_number("turning radius (m)", 1.0, min=0.01, step=0.05, visible=False)
        self.time_limit = gui.add_number("time limit (s)", 1.0, min=0.1, max=3600.0, step=0.5)
        self.exact = gui.add_checkbox(
            "exact",
            False,
            hint="Ask the geometry itself where the grid cannot decide; slower.",
            visible=canvas.has_cells,
        )
        self.plan = gui.add_button("Plan")
        self.proof = gui.add_markdown("Finding out what is joined …" if canvas.is_quick else "")
        self.answer = gui.add_markdown("")
        curves = choices.curves if choices else ()

        def chosen(_: Any) -> None:
            self.turning_radius.visible = self.drive.value in curves

        self.drive.on_update(chosen)

    def typed(self, name: str) -> tuple[float, ...]:
        """What is typed of the start or the goal: the numbers of :attr:`Canvas.dials`."""
        return tuple(float(number) for each in self._typed[name] for number in np.atleast_1d(each.value))

    def on_typed(self, name: str, typed: Callable[[], None]) -> None:
        """Have ``typed`` called when somebody types numbers of the start or the goal."""
        for handle in self._typed[name]:
            handle.on_update(lambda event: typed() if event.client is not None else None)

    def write(self, name: str, numbers: tuple[float, ...]) -> None:
        """Show the numbers of the start or the goal."""
        for (_, which), handle in zip(self._canvas.typed, self._typed[name], strict=True):
            handle.value = _as_value(tuple(round(number, 3) for number in numbers[which]))

    def slide(self, numbers: tuple[float, ...]) -> None:
        """Show the numbers of the robot."""
        for slider, number in zip(self.sliders, numbers, strict=True):
            slider.value = min(max(number, slider.min), slider.max)

    def follow(self, most: float | None) -> None:
        """Begin at the start of a path, of which the largest distance is given; None if there is no path."""
        self.share.value = 0.0
        self.share.disabled = self.play.disabled = most is None
        none = "Plan one, or open the page with a path."
        self.scale.content = (
            _note(none) if most is None else _scale(most, self._canvas.unit, self._canvas.distance_name)
        )


class Page:
    """A page: what it shows, and what people and programs do there.

    ``path``, shape (n, size), is one to show; n is 0 where there is none.

    Attributes
    ----------
    panel : Panel
        What can be set, and what is said.
    marks : dict of str to ndarray of float64, shape (size,)
        The start and the goal.
    plan : planners.Plan or None
        What the last search found.
    """

    def __init__(self, server: ViserServer, space: Any, canvas: Canvas, path: Floats) -> None:
        self._server, self._space, self._canvas = server, space, canvas
        self.marks, self.plan = dict(canvas.endpoints), None  # type: dict[str, Floats], Plan | None
        self._path, self._proves = path, canvas.is_quick
        self._playing = threading.Event()
        works = canvas.draw, self._describe, self._prove, self._search, self._play
        self._workers = [Worker(work, self._fail) for work in works]
        self._drawer, self._describer, self._prover, self._planner, self._player = self._workers
        self.panel = Panel(server.gui, canvas, _choices(space), self._drawer.request)
        self._heed()
        for name, q in canvas.endpoints.items():
            self.mark(name, q)
        self._follow(path)
        self.move(canvas.endpoints["start"])
        server.on_client_connect(self._watch)

    def _heed(self) -> None:
        """Have done what people ask for on the page."""
        panel, canvas = self.panel, self._canvas

        def slid(event: Any) -> None:
            if event.client is not None:
                self._playing.clear()
                self._place(canvas.of(tuple(float(slider.value) for slider in panel.sliders)))

        def shared(event: Any) -> None:
            if event.client is not None and len(self._path):
                self._playing.clear()
                self.go(panel.share.value / 100.0)

        for name in self.marks:
            panel.on_typed(name, partial(self._mark_typed, name))
            canvas.on_drag(name, partial(self._marked, name))
        for slider in panel.sliders:
            slider.on_update(slid)
        panel.share.on_update(shared)
        panel.plan.on_click(lambda _: self.search())
        panel.play.on_click(lambda _: self._playing.clear() if self._playing.is_set() else self.play())
        panel.make_it.on_click(lambda event: self.mark(event.target.value, canvas.robot))

    # ---- what programs do --------------------------------------------------------------------------------------------

    def move(self, q: Floats) -> None:
        """Move the robot to a configuration, and show what depends on it."""
        self.panel.slide(self._canvas.numbers(q))
        self._place(q)

    def _place(self, q: Floats) -> None:
        self._canvas.place(q)
        self._drawer.request()
        self._describer.request()

    def go(self, share: float) -> None:
        """Move the robot to a share, from 0 to 1, of the length of the path."""
        self.move(self._canvas.along(self._path, np.array([share]))[0])

    def mark(self, name: str, q: Floats) -> None:
        """Move the start or the goal to a configuration."""
        self._canvas.mark(name, q)
        self._marked(name, q)

    def _mark_typed(self, name: str) -> None:
        self.mark(name, self._canvas.of(self.panel.typed(name)))

    def _marked(self, name: str, q: Floats) -> None:
        """Note where the start or the goal is."""
        self.marks[name] = q
        self.panel.write(name, self._canvas.numbers(q))
        self.panel.answer.content = ""  # it was about other ones
        self._prover.request()

    def search(self) -> None:
        """Plan from the start to the goal, as the panel is set; :attr:`plan` is what comes out."""
        self._planner.request()

    def play(self) -> None:
        """Move the robot along the path, from where it is."""
        self._playing.set()
        self._player.request()

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
        for worker in self._workers:
            worker.close()

    # ---- what is done in threads -------------------------------------------------------------------------------------

    def _describe(self) -> None:
        """Say what is proven of the robot's configuration."""
        self.panel.state.content = self._canvas.describe(self._canvas.robot)

    def _prove(self) -> None:
        """Say what is proven of start and goal."""
        if self._proves:
            self.panel.proof.content = self._canvas.prove(self.marks["start"], self.marks["goal"])

    def _search(self) -> None:
        """Plan, and say what came out."""
        import planners

        panel = self.panel
        panel.answer.content = "Planning …"
        panel.plan.disabled = True
        try:
            self.plan = plan = planners.plan(
                self._space,
                self.marks["start"],
                self.marks["goal"],
                planner=None if panel.planner.value == AUTOMATIC else panel.planner.value,
                time_limit=float(panel.time_limit.value),
                exact=bool(panel.exact.value),
                drive=panel.drive.value,
                turning_radius=float(panel.turning_radius.value) if panel.turning_radius.visible else None,
            )
        finally:
            panel.plan.disabled = False
        self._proves = True  # what the cells join is known from here on
        self._prover.request()
        self._follow(plan.path)
        if plan.solved:
            self.move(plan.path[0])
        panel.answer.content = _plan_text(plan)

    def _play(self) -> None:
        """Move the robot along the path, until it is there or someone stops it."""
        panel = self.panel
        panel.play.label = "Stop"
        share = panel.share.value / 100.0 if panel.share.value < 100.0 else 0.0
        began = time.perf_counter() - share * SECONDS
        try:
            while self._playing.is_set() and share < 1.0 and len(self._path):
                share = min(1.0, (time.perf_counter() - began) / SECONDS)
                panel.share.value = round(100.0 * share, 1)
                self.go(share)
                sent = time.perf_counter()
                self._let_draw()
                taken = time.perf_counter() - sent
                time.sleep(max(1.0 / FRAMES - taken, REST * taken))
        finally:
            self._playing.clear()
            panel.play.label = "Play"

    def _let_draw(self) -> None:
        """Wait until all browsers have come to what was sent."""
        self._server.flush()
        for client in self._server.get_clients().values():
            with suppress(RuntimeError, TimeoutError):  # it has left, stores nothing, or is slow
                client.local_storage.get_item("", BEHIND)  # a browser answers in turn; what it stores does not matter

    def _follow(self, path: Floats) -> None:
        """Show a path, from its start."""
        self._playing.clear()
        self._path = path
        most = self._canvas.follow(path)
        self.panel.follow(most if len(path) else None)

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
        self.panel.answer.content = f"**Not done:** {message}"


def _plan_text(plan: Plan) -> str:
    """A plan, and what it proves."""
    if not plan.solved:
        hint = f"  \nTry {plan.hint}." if plan.hint else ""
        return f"**{plan.status[:1].upper()}{plan.status[1:]}.**{hint}"
    proof = "certified: every edge is proven free" if plan.certified else "not certified"
    apart = f", {plan.distance_text}" if plan.distance_text else ""
    seconds = plan.times.planning + plan.times.simplification
    took = f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
    text = f"**{plan.status[:1].upper()}{plan.status[1:]}**, {proof}."
    return f"{text}  \n{plan.length:.3f} {plan.length_unit}{apart}  \n{plan.planner}, {took}"


def _choices(space: Any) -> Choices | None:
    """Return what a plan can be given on a space; None if OMPL is not installed, which a search reports."""
    try:
        import planners
    except MissingPackageError:
        return None
    return planners.choices(space)


def _legend(rows: list[tuple[str, str]]) -> str:
    """Colours, and what they mean."""
    square = "display:inline-block;width:0.9em;height:0.9em;margin-right:0.5em;border:1px solid #777;background:"
    items = "".join(
        f'<div style="margin:0.15em 0"><span style="{square}{color}"></span>{html.escape(name)}</div>'
        for color, name in rows
    )
    return f'<div style="font-size:0.8em;padding:0.4em 0.8em">{items}</div>'


def _scale(most: float, unit: str, name: str) -> str:
    """The colours of the path."""
    if math.isnan(most):
        return _note(f"A map in a store gives no {name} here.")
    bar = f"height:0.6em;border-radius:0.3em;background:linear-gradient(to right,{LOW},{HIGH})"
    row = "display:flex;justify-content:space-between"
    return (
        f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em"><div style="{bar}"></div>'
        f'<div style="{row}"><span>0</span><span>{name}</span><span>{most:.2g} {unit}</span></div></div>'
    )


def _note(text: str) -> str:
    return f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em;color:#777">{html.escape(text)}</div>'


def _as_value(numbers: tuple[float, ...]) -> Any:
    """As an input takes numbers: one alone, or several."""
    return numbers if len(numbers) > 1 else numbers[0]


class Worker:
    """Does some work at each request; once for all requests that come while it is busy.

    ``fail`` is given what the work raises; the next time it is done again.
    """

    def __init__(self, work: Callable[[], None], fail: Callable[[Exception], None]) -> None:
        self._work, self._fail = work, fail
        self._changed = threading.Condition()
        self._requested, self._busy, self._open = False, False, True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def request(self) -> None:
        """Have the work done, once what is under way is done."""
        with self._changed:
            self._requested = True
            self._changed.notify_all()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until all that was requested is done; gives whether it is."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._requested or self._busy), seconds)

    def close(self) -> None:
        """Do nothing more, once what is under way is done."""
        with self._changed:
            self._open = self._requested = False
            self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._requested or not self._open)
                if not self._open:
                    return
                self._requested, self._busy = False, True
            try:
                self._work()
            except Exception as error:  # whatever it is, the page goes on
                if self._open:
                    self._fail(error)
