"""The panel of a page: what can be set there, and what is said."""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.view.canvas import MARKS, Canvas
from cspace.view.scene import HIGH, LOW

if TYPE_CHECKING:
    from viser import GuiApi

    from planners import Choices

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
            "planner", (AUTOMATIC, *planners), hint="Of OMPL; Cubes and Widest are a map's own."
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
        """Begin at the start of a path, of which the largest clearance is given; None if there is no path."""
        self.share.value = 0.0
        self.share.disabled = self.play.disabled = most is None
        none = "Plan one, or open the page with a path."
        self.scale.content = _note(none) if most is None else _scale(most, self._canvas.unit)


def _legend(rows: list[tuple[str, str]]) -> str:
    """Colours, and what they mean."""
    square = "display:inline-block;width:0.9em;height:0.9em;margin-right:0.5em;border:1px solid #777;background:"
    items = "".join(
        f'<div style="margin:0.15em 0"><span style="{square}{color}"></span>{html.escape(name)}</div>'
        for color, name in rows
    )
    return f'<div style="font-size:0.8em;padding:0.4em 0.8em">{items}</div>'


def _scale(most: float, unit: str) -> str:
    """The colours of the path."""
    if math.isnan(most):
        return _note("A map in a store gives no clearance here.")
    bar = f"height:0.6em;border-radius:0.3em;background:linear-gradient(to right,{LOW},{HIGH})"
    row = "display:flex;justify-content:space-between"
    return (
        f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em"><div style="{bar}"></div>'
        f'<div style="{row}"><span>0</span><span>clearance</span><span>{most:.2g} {unit}</span></div></div>'
    )


def _note(text: str) -> str:
    return f'<div style="font-size:0.8em;padding:0.2em 0.8em 0.6em;color:#777">{html.escape(text)}</div>'


def _as_value(numbers: tuple[float, ...]) -> Any:
    """As an input takes numbers: one alone, or several."""
    return numbers if len(numbers) > 1 else numbers[0]
