"""The behaviour of a page: what moves the robot, what plans, and what is proven in words."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Floats
from cspace.errors import CspaceError, MissingPackageError
from cspace.view.canvas import Canvas
from cspace.view.panel import AUTOMATIC, Panel

if TYPE_CHECKING:
    from viser import ViserServer

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


class Page:
    """A page: what it shows, and what people and programs do there.

    ``path``, shape (n, dof), is one to show; n is 0 where there is none.

    Attributes
    ----------
    panel : Panel
        What can be set, and what is said.
    marks : dict of str to ndarray of float64, shape (dof,)
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
        advice = f"  \nTry {plan.advice}." if plan.advice else ""
        return f"**{plan.status[:1].upper()}{plan.status[1:]}.**{advice}"
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
