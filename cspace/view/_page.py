"""A page: its panel of inputs and messages, and its actions.

A user moves the robot, drags a tool, plans, plays and proves.
"""

from __future__ import annotations

import html
import logging
import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Full, Queue
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from cspace.errors import CspaceError, InputError
from cspace.inside import Floats
from cspace.plot.scene import SOLID_ENDPOINT_COLORS

if TYPE_CHECKING:
    from viser import GuiApi, ViserServer

    from cspace.arms import PoseGoal
    from cspace.view._arm_canvas import ArmCanvas
    from cspace.view._map_canvas import MapCanvas
    from cspace.view._tool import ToolFrame
    from planners import Car, Choices, Differential, Plan, Trajectory

LOGGER: Final = logging.getLogger(__name__)

FRAME_RATE: Final = 25.0
"""Number of frames per second when a path is played."""
AUTOMATIC: Final = "automatic"
"""Label of the default planner."""

ANY_DIRECTION: Final = "any direction"
DIFFERENTIAL: Final = "differential"
CAR: Final = "car"
"""Labels of drives."""


class Panel:
    """The inputs and messages of a page, as viser's handles.

    Inputs have a ``value``, which programs may set too; messages have a ``content``.

    Parameters
    ----------
    gui : viser.GuiApi
    canvas : ArmCanvas or MapCanvas
    choices : planners.Choices
        Planners and drives.
    changed : callable
        Called when a user chooses other things to draw.

    Attributes
    ----------
    planner, drive : GuiDropdownHandle
    reverse : GuiInputHandle of bool
        Whether the robot drives backwards, too.
    turning_radius, time_limit : GuiInputHandle of float
        Metres, for cars; seconds.
    exact : GuiInputHandle of bool
        Check the exact geometry in MIXED cells.
    plan : GuiButtonHandle
    proof, answer : GuiMarkdownHandle
        Proof about start and goal; result of the last search, or an error.
    share : GuiSliderHandle of float
        Position of the robot on the path, percent of the path's length, or of the trajectory's
        duration.
    play : GuiButtonHandle
    tool : GuiMarkdownHandle
        Whether the arm reaches the pose to which its frame was dragged.
    sliders : list of GuiSliderHandle of float
        Robot's coordinates, one for each of :attr:`Canvas.dials`.
    state : GuiMarkdownHandle
        State of the robot's configuration.
    set_endpoint : GuiButtonGroupHandle
        Set start or goal to the robot's configuration.
    shown : dict of str to GuiInputHandle
        Choices of what is drawn, by label.
    """

    def __init__(
        self,
        gui: GuiApi,
        canvas: ArmCanvas | MapCanvas,
        choices: Choices,
        changed: Callable[[], None],
    ) -> None:
        """Add all inputs and messages to a page, folder by folder."""
        self._gui = gui
        self._canvas = canvas
        gui.configure_theme(
            show_logo=False,
            show_share_button=False,
            control_width="large",
            brand_color=(0, 114, 178),
        )
        gui.main_panel.dock_right()
        gui.add_markdown(f"**{canvas.title}**  \n{canvas.about}")
        with gui.add_folder("Plan"):
            self._add_plan_inputs(choices)
        if canvas.tool is not None:
            with gui.add_folder(f"Tool: {canvas.tool.name}"):
                self.tool = gui.add_markdown("Drag the frame: release it to plan there.")
        with gui.add_folder("Path"):
            self.share: Any = gui.add_slider("along it (%)", 0.0, 100.0, 0.1, 0.0)
            self.play = gui.add_button("Play")
        with gui.add_folder("Robot"):
            self.sliders: list[Any] = [
                gui.add_slider(dial.label, dial.low, dial.high, dial.step, dial.low)
                for dial in canvas.dials
            ]
            self.state = gui.add_markdown("")
            self.set_endpoint = gui.add_button_group("make it the", tuple(canvas.endpoints))
        with gui.add_folder("Show"):
            self.shown = canvas.add_choices(gui, changed)
            gui.add_html(_make_legend_html([*canvas.legend, *SOLID_ENDPOINT_COLORS.items()]))

    def _add_plan_inputs(self, choices: Choices) -> None:
        """Add the inputs and messages of planning, for these planners and drives."""
        gui = self._gui
        canvas = self._canvas
        self.planner = gui.add_dropdown(
            "planner",
            (AUTOMATIC, *choices.planners),
            hint="OMPL's planners; maps also have Grid.",
        )
        has_drives = bool(choices.drives)
        self.drive = gui.add_dropdown(
            "drive",
            (ANY_DIRECTION, DIFFERENTIAL, CAR),
            hint="How the robot moves.",
            visible=has_drives,
        )
        self.reverse = gui.add_checkbox("may reverse", False, visible=has_drives)
        self.turning_radius = gui.add_number(
            "turning radius (m)", 1.0, min=0.01, step=0.05, visible=has_drives
        )
        self.time_limit = gui.add_number("time limit (s)", 1.0, min=0.1, max=3600.0, step=0.5)
        self.exact = gui.add_checkbox(
            "exact",
            False,
            hint="Check the exact geometry in undecided cells; slower.",
            visible=canvas.tool is None,
        )
        self.plan = gui.add_button("Plan")
        self.proof = gui.add_markdown("")
        self.answer = gui.add_markdown("")

    def read_options(self) -> dict[str, Any]:
        """Return the inputs of a search as options of :func:`planners.plan`."""
        planner = self.planner.value
        return {
            "planner": None if planner == AUTOMATIC else planner,
            "time_limit": float(self.time_limit.value),
            "drive": self._read_drive(),
        }

    def _read_drive(self) -> Car | Differential | None:
        """Return the drive that is chosen; None for any direction."""
        from planners import Car, Differential

        reverse = bool(self.reverse.value)
        if self.drive.value == CAR:
            return Car(turning_radius=float(self.turning_radius.value), reverse=reverse)
        return Differential(reverse=reverse) if self.drive.value == DIFFERENTIAL else None

    def show_robot(self, numbers: tuple[float, ...]) -> None:
        """Set the robot's sliders to values within limits."""
        for slider, number in zip(self.sliders, numbers, strict=True):
            slider.value = min(max(number, slider.min), slider.max)


class Page:
    """Page in the browser that shows a space and plans in it.

    Parameters
    ----------
    server : viser.ViserServer
    space : ConfigurationSpace
    canvas : ArmCanvas or MapCanvas
    path : ndarray of float64, shape (n, size)
        Path to show; n is 0 without a path.
    source : object
        The plan, trajectory or array that the path is from. Trajectories, and plans of arms, are
        played at true speed.

    Attributes
    ----------
    panel : Panel
        Inputs and messages.
    endpoints : dict of str to ndarray of float64, shape (size,)
        Start and goal.
    plan : planners.Plan or None
        Result of the last search.
    trajectory : planners.Trajectory or None
        Motion along the path shown; None if it has no times.
    """

    def __init__(
        self,
        server: ViserServer,
        space: Any,
        canvas: ArmCanvas | MapCanvas,
        path: Floats,
        source: object,
    ) -> None:
        """Add the panel; show the path and the robot."""
        import planners

        self._server = server
        self._space = space
        self._canvas = canvas
        self.endpoints = dict(canvas.endpoints)
        self.plan: Plan | None = None
        self.trajectory: Trajectory | None = None
        self._path = path
        # True if a drag of the tool, not a plan or a slider, moved the arm to where it stands.
        self._was_dragged = False
        self._goal: PoseGoal | None = None
        self._playing = threading.Event()
        self._closing = threading.Event()
        # Each kind of work has a thread, so that the page always answers.
        self._renderer = Worker(self._show, self._report_error)
        self._prover = Worker(self._prove, self._report_error)
        self._planner = Worker(self._search, self._report_error)
        self._player = Worker(self._play, self._report_error)
        self._solver = Worker(self._reach, self._report_error)
        self.panel = Panel(server.gui, canvas, planners.choices(space), self._renderer.request)
        self._connect()
        for name, q in canvas.endpoints.items():
            self.set_endpoint(name, q)
        self._show_path(path, source)
        self.move(canvas.endpoints["start"])

    def _connect(self) -> None:
        """Connect the inputs of the panel to actions."""
        panel = self.panel
        canvas = self._canvas

        # Programs set sliders too, to show the robot's place; only a user's event has a client.
        def slide_robot(event: Any) -> None:
            """Move the robot to the configuration of the sliders."""
            if event.client is not None:
                self._playing.clear()
                numbers = tuple(float(slider.value) for slider in panel.sliders)
                self._place(canvas.configuration_of(numbers))

        def slide_along_path(event: Any) -> None:
            """Move the robot to the place of the slider on its path."""
            if event.client is not None and len(self._path):
                self._playing.clear()
                self.go(panel.share.value / 100.0)

        for name in self.endpoints:
            canvas.on_drag(name, partial(self._record_endpoint, name))
        for slider in panel.sliders:
            slider.on_update(slide_robot)
        panel.share.on_update(slide_along_path)
        panel.plan.on_click(lambda _: self.search())
        panel.play.on_click(lambda _: self._play_or_stop())
        panel.set_endpoint.on_click(
            lambda event: self.set_endpoint(event.target.value, canvas.robot)
        )
        if canvas.tool is not None:
            canvas.tool.on_drag(self._follow_tool, self.release)

    # ---- actions for programs --------------------------------------------------------------------

    def move(self, q: Floats) -> None:
        """Move the robot to a configuration."""
        self.panel.show_robot(self._canvas.dial_values(q))
        self._place(q)

    def _place(self, q: Floats) -> None:
        """Draw the robot at a configuration of any source."""
        self._was_dragged = False
        self._canvas.place(q)
        self._renderer.request()

    def go(self, share: float) -> None:
        """Move the robot to a share, 0 to 1, of its path.

        A trajectory is divided by time, another path by length.
        """
        motion = self.trajectory
        if motion is not None:
            q, *_ = motion.sample(share * motion.duration)
        else:
            (q,) = self._canvas.interpolate(self._path, np.array([share]))
        self.move(q)

    def drag(self, pose: Floats) -> None:
        """Drag an arm's tool frame to a pose (4, 4).

        The arm follows as near as it can. Its configuration before the drag becomes the start.
        """
        tool = self._canvas.tool
        if tool is None:
            raise InputError("pose", "is given for a map", "only arms have frames")
        self._follow_tool(tool)
        tool.move(pose)

    def _follow_tool(self, tool: ToolFrame) -> None:
        """Make the arm follow its tool frame, which a user drags."""
        if not tool.is_held:
            self._playing.clear()
            # After a drag without a plan, the arm has not moved from the start, so it stays.
            if not self._was_dragged:
                self.set_endpoint("start", self._canvas.robot)
            no_path = np.empty((0, self._space.size))
            self._show_path(no_path)
            tool.is_held = True
            self._was_dragged = True
        self._solver.request()

    def release(self) -> None:
        """Plan from the start to the tool's dragged pose."""
        tool = self._canvas.tool
        if tool is not None and tool.is_held:
            tool.is_held = False
            self._goal = tool.goal
            self._planner.request()

    def set_endpoint(self, name: str, q: Floats) -> None:
        """Move the start or the goal to a configuration."""
        self._canvas.set_endpoint(name, q)
        self._record_endpoint(name, q)

    def _record_endpoint(self, name: str, q: Floats) -> None:
        """Record a new start or goal."""
        self.endpoints[name] = q
        self.panel.answer.content = ""  # the answer concerned the previous endpoints
        self._prover.request()

    def search(self) -> None:
        """Plan from start to goal with the inputs of the panel.

        The result is :attr:`plan`.
        """
        self._planner.request()

    def play(self) -> None:
        """Move the robot along the path from here.

        A trajectory is played at true speed.
        """
        self._playing.set()
        self._player.request()

    def _play_or_stop(self) -> None:
        """Play the path, or stop it if it plays."""
        if self._playing.is_set():
            self._playing.clear()
        else:
            self.play()

    def refresh(self) -> None:
        """Draw and prove everything again after changes."""
        self._canvas.invalidate()
        self._renderer.request()
        self._prover.request()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until all requested work is done; return False after a timeout."""
        # A worker may request work of the workers after it, so they are waited for in this order.
        workers = self._solver, self._planner, self._renderer, self._prover
        return all(worker.wait(seconds) for worker in workers)

    def close(self) -> None:
        """Stop all threads."""
        self._playing.clear()
        self._closing.set()
        workers = self._renderer, self._prover, self._planner, self._player, self._solver
        for worker in workers:
            worker.close()
        for worker in workers:
            # Largest time that a page waits for each of its threads when it closes.
            worker.wait(5.0)  # viser warns of what is sent after the server has stopped

    # ---- work in threads -------------------------------------------------------------------------

    def _show(self) -> None:
        """Draw the cells at the robot's rotation, and describe its state."""
        self._canvas.draw()
        self.panel.state.content = self._canvas.describe(self._canvas.robot)

    def _prove(self) -> None:
        """Show the proofs about start and goal."""
        self.panel.proof.content = self._canvas.prove(
            self.endpoints["start"], self.endpoints["goal"]
        )

    def _reach(self) -> None:
        """Move the arm to its dragged tool frame, and show the outcome."""
        problem = self._canvas.reach()
        q = self._canvas.robot
        self.panel.show_robot(self._canvas.dial_values(q))
        self.set_endpoint("goal", q)
        self.panel.tool.content = self._describe_reach(q, problem)
        self._renderer.request()

    def _describe_reach(self, q: Floats, problem: str) -> str:
        """Describe in Markdown whether the arm reached its tool frame."""
        if problem:
            return f"**Not reached**; the arm shows the nearest pose.  \n{_capitalize(problem)}."
        if self._space.is_free(q):
            return "**Reached**, proven free."
        return "**Reached**, but not proven free."

    def _search(self) -> None:
        """Plan from start to goal, and show the result."""
        import planners

        panel = self.panel
        pose = self._goal
        self._goal = None
        self._solver.wait()  # so that the arm follows the tool before a plan moves it
        goal = self.endpoints["goal"] if pose is None else pose
        panel.answer.content = "Planning …"
        panel.plan.disabled = True
        try:
            options = panel.read_options()
            space = self._space.exact if panel.exact.value else self._space
            start = self.endpoints["start"]
            stop = self._closing.is_set
            self.plan = plan = planners.plan(space, start, goal, stop=stop, **options)
        finally:
            panel.plan.disabled = False
        self._prover.request()
        if pose is None:
            self._show_path(plan.path, plan)
            if plan:
                self.move(plan.path[0])
        elif plan:
            self._show_plan_of_tool(plan)
        panel.answer.content = _describe_plan(plan)

    def _show_plan_of_tool(self, plan: Plan) -> None:
        """Show the end of a plan to a released tool frame.

        Skipped if users hold the frame again.
        """
        tool = self._canvas.tool
        if tool is not None and not tool.is_held:
            self.set_endpoint("goal", plan.goal)
            self._show_path(plan.path, plan)
            self.panel.share.value = 100.0
            self.go(1.0)

    def _play(self) -> None:
        """Move the robot along the path until its end or until stopped."""
        panel = self.panel
        panel.play.label = "Stop"
        # Go on from the current place; at the end, begin again.
        at_end = panel.share.value >= 100.0
        share = 0.0 if at_end else panel.share.value / 100.0
        seconds = 8.0  # for a path without times
        if self.trajectory is not None:
            seconds = max(self.trajectory.duration, 1.0 / FRAME_RATE)
        began = time.perf_counter() - share * seconds
        try:
            while self._playing.is_set() and share < 1.0 and len(self._path):
                share = min(1.0, (time.perf_counter() - began) / seconds)
                panel.share.value = round(100.0 * share, 1)
                self.go(share)
                time.sleep(1.0 / FRAME_RATE)
        finally:
            self._playing.clear()
            panel.play.label = "Play"

    def _show_path(self, path: Floats, source: object = None) -> None:
        """Show a path, and the slider at its start."""
        self._playing.clear()
        self._path = path
        self._canvas.draw_path(path)
        self.panel.share.value = 0.0
        is_empty = len(path) == 0
        self.panel.share.disabled = is_empty
        self.panel.play.disabled = is_empty
        self.trajectory = self._time_path(source)

    def _time_path(self, source: Any) -> Trajectory | None:
        """Return the motion of a trajectory, or of an arm's plan.

        None for paths without times.
        """
        if hasattr(source, "sample"):
            return cast("Trajectory", source)
        is_arm = self._canvas.tool is not None
        if not hasattr(source, "trajectory") or not is_arm or not len(self._path):
            return None
        # Joints without a velocity limit in the URDF get 1 rad/s or 1 m/s. A URDF has no limits of
        # acceleration, so all joints get 2 rad/s2 or 2 m/s2.
        limits = self._space.max_velocity.items()
        max_velocity = {joint: 1.0 for joint, limit in limits if math.isinf(limit)}
        motion: Trajectory = source.trajectory(max_velocity=max_velocity, max_acceleration=2.0)
        return motion

    def _report_error(self, error: Exception) -> None:
        """Show an error on the page; log defects, too."""
        message = str(error)
        if not isinstance(error, CspaceError):
            LOGGER.error("error in a thread of the page", exc_info=error)
            message = repr(error)
        self.panel.answer.content = f"**Not done:** {message}"


def _describe_plan(plan: Plan) -> str:
    """Describe a plan and its proof in Markdown."""
    status = _capitalize(plan.status)
    if not plan:
        hint = f"  \nTry {plan.hint}." if plan.hint else ""
        return f"**{status}.**{hint}"
    proof = "certified: every edge is proven free" if plan.certified else "not certified"
    length = f"{plan.length:.3f} {plan.length_unit}"
    distance = _describe_distance(plan)
    seconds = plan.times.planning
    duration = f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
    lines = [f"**{status}**, {proof}.", length + distance, f"{plan.planner}, {duration}"]
    return "  \n".join(lines)


def _describe_distance(plan: Plan) -> str:
    """Describe the obstacle distance of a path, or its clearance if it has none."""
    words, distance, unit = "obstacle distance", plan.obstacle_distance, "m"
    if math.isnan(distance):
        words, distance, unit = "clearance", plan.clearance, plan.length_unit
    if math.isnan(distance):
        return ""
    if distance == 0.0:
        return f", {words} not proven to be more than 0"
    number = f"{distance:.3f}" if distance >= 5e-4 else f"{distance:.1g}"
    return f", {words} {number} {unit}"


def _capitalize(text: str) -> str:
    """Return a text with a capital first letter and the rest unchanged."""
    return text[:1].upper() + text[1:]


def _make_legend_html(rows: list[tuple[str, str]]) -> str:
    """Return an HTML legend of meanings and colours."""
    square = (
        "display:inline-block;width:0.9em;height:0.9em;margin-right:0.5em;border:1px solid "
        "#777;background:"
    )
    items = []
    for name, color in rows:
        sample = f'<span style="{square}{color}"></span>'
        items.append(f'<div style="margin:0.15em 0">{sample}{html.escape(name)}</div>')
    return f'<div style="font-size:0.8em;padding:0.4em 0.8em">{"".join(items)}</div>'


class Worker:
    """A thread that runs a task on request.

    Requests during a run cause one more run. Exceptions of the task are passed to ``report``; the
    thread continues.
    """

    def __init__(self, task: Callable[[], None], report: Callable[[Exception], None]) -> None:
        """Start the thread, which waits for a request."""
        # One request waits at most, while the task runs.
        self._requests: Queue[None] = Queue(1)
        self._open = True
        threading.Thread(target=self._run, args=(task, report), daemon=True).start()

    def request(self) -> None:
        """Request a run, after the current one."""
        with suppress(Full):
            self._requests.put_nowait(None)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until all requested runs are done; return False after a timeout."""
        requests = self._requests
        with requests.all_tasks_done:
            return requests.all_tasks_done.wait_for(lambda: not requests.unfinished_tasks, seconds)

    def close(self) -> None:
        """Stop the thread after the current run."""
        self._open = False
        self.request()

    def _run(self, task: Callable[[], None], report: Callable[[Exception], None]) -> None:
        """Run the task whenever it was requested, until closed."""
        while True:
            self._requests.get()
            try:
                if not self._open:
                    return
                task()
            except Exception as error:  # a failed task must not end the thread
                if self._open:
                    report(error)
            finally:
                self._requests.task_done()
