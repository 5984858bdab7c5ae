"""Options shared by commands, and parsers of their texts."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal

import typer

from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace import Robot, Rotations
    from cspace.inside import ConfigurationMap

Solid = Literal["auto", "surface", "fill"]
"""Part of a mesh that is solid; see :meth:`cspace.Workspace.from_mesh`."""
Up = Literal["x", "y", "z"]
"""Axis of a mesh that points up."""


def option(metavar: str | None, text: str = "", *names: str, default: Any = None) -> Any:
    """Declare an option of a command, as the default of its parameter.

    ``text`` is for the help. By default, the option has the name of the parameter. With an ellipsis
    as ``default``, the option is required.
    """
    # readable=False keeps typer from checking files before a command runs, because the library's
    # messages are better.
    return typer.Option(default, *names, metavar=metavar, help=text, readable=False)


def flag(name: str, text: str) -> Any:
    """Declare an option without a value, which sets its parameter to True."""
    return option(None, text, name, default=False)


def argument(metavar: str, text: str) -> Any:
    """Declare a positional argument, as its parameter's default."""
    return typer.Argument(metavar=metavar, help=text, readable=False)


CONFIGURATION: Final = "X,Y[,Z][,ROTATION]"
"""Placeholder of a configuration in the help."""

AS_JSON: Final = flag("--json", "Print one JSON document, for machines.")
OVERWRITE: Final = flag("--overwrite", "Replace existing outputs.")
MAP_FILE: Final = argument("MAP", "A saved map: .zarr.")
PATH_FILE: Final = option("FILE", "A path to show: .csv or .json.", "--path")
MARK: Final = option(
    CONFIGURATION,
    "A configuration to mark, metres, or the joints of a map of joints  [default: an end of the "
    "path].",
)
SOLID: Final = option(
    None,
    "What has an inside in a mesh of obstacles: closed parts, nothing, or what it encloses at this "
    "spacing  [default: auto].",
    "--solid",
)
PACKAGE_DIRS: Final = option(
    "DIR",
    "Folder that holds the ROS packages of a URDF's meshes; may be repeated.",
    "--package-dir",
)
SRDF: Final = option("FILE", "For an arm: which links may touch, and its groups.", "--srdf")
VISUALS: Final = flag(
    "--visuals", "Also take what a URDF only draws, of links with <visual> alone."
)
DROP_MISSING: Final = flag("--drop-missing", "Leave out points of a cloud that are not finite.")
"""Declarations that commands share."""


def open_robot(text: str, **given: Any) -> Robot:
    """Open a robot from a shorthand or a file.

    ``footprint:`` before a file projects the robot into the plane.

    ``given`` are options of :meth:`cspace.Robot.open`; unset ones are omitted. Raises
    CspaceError as :meth:`cspace.Robot.parse` and :meth:`cspace.Robot.open`; InputError if a short
    text has options.
    """
    from cspace import Robot

    options = drop_unset(**given)
    # A list of corners, a shorthand, or the name of a file follows "footprint:".
    prefix, _, file = text.partition("footprint:")
    has_file = file and not file.lstrip().startswith("[") and not _is_shorthand(file)
    if prefix == "" and has_file:
        return Robot.open(file, **options).footprint()
    if not _is_shorthand(text):
        return Robot.open(text, **options)
    for name, value in options.items():
        is_for_meshes = name in ("solid", "up")
        rule = "it is for meshes, such as .stl" if is_for_meshes else "it is for .urdf"
        raise InputError(name, f"is {value!r} for {text}", rule)
    return Robot.parse(text)


def _is_shorthand(text: str) -> bool:
    """Return True for a text such as ``disc:0.3``, unless a file has that name."""
    name, colon, _ = text.partition(":")
    # A Path refuses texts that are too long for a name.
    return bool(colon) and name.isalpha() and not os.path.exists(text)  # noqa: PTH110


def refuse_options(options: Mapping[str, object], taken: Collection[str], about: str) -> None:
    """Raise InputError for the first option not in ``taken``; ``about`` describes the file."""
    for name in options:
        if name not in taken:
            raise InputError(name, f"is given, but {about}")


def parse_rotation_cells(text: str | None) -> Rotations:
    """Parse ``--rotations``, such as ``72`` or ``quaternions:8``; raise InputError otherwise."""
    from cspace import Rotations

    if text is None:
        return Rotations.of(None)
    kinds = {"yaw": Rotations.of, "quaternions": Rotations.quaternions}
    makers = {"": Rotations.of, **kinds}
    name, _, count = text.rpartition(":")
    if name not in makers or not count.isdecimal() or int(count) == 0:
        examples = " or ".join(f"{kind}:8" for kind in kinds)
        rule = f"it must be a count above zero, or a kind and a count, {examples}"
        raise InputError("rotations", f"is {text!r}", rule)
    return makers[name](int(count))


def parse_configuration(
    text: str, argument: str, axes: Sequence[str], units: Sequence[str]
) -> tuple[float, ...]:
    """Parse the configuration in an argument such as ``start``.

    ``units`` has "m", "rad" or "1" for each axis. Angles may be in degrees: ``90deg``. Raises
    InputError if the text does not have one number for each axis, separated by commas.
    """
    measures = "radians or degrees"
    if "m" in units:
        angles = [axis for axis, unit in zip(axes, units, strict=True) if unit == "rad"]
        measures = ", ".join(["metres", *(f"{axis} an angle" for axis in angles)])
    rule = f"the map's configurations are {','.join(axes)}, in {measures}"
    return _parse_numbers(text, argument, axes, units, rule)


def read_marks(
    start: str | None, goal: str | None, axes: Sequence[str], units: Sequence[str]
) -> dict[str, tuple[float, ...]]:
    """Parse ``--start`` and ``--goal``, if given, by :func:`parse_configuration`."""
    texts = drop_unset(start=start, goal=goal)
    return {name: parse_configuration(text, name, axes, units) for name, text in texts.items()}


def parse_rotation(text: str, argument: str, space: ConfigurationMap) -> tuple[float, ...]:
    """Parse the rotation in an argument such as ``rotation``.

    Raises InputError if the map has no rotations, or if the text is no rotation of it.
    """
    axes = space.axes[space.dim :]
    units = space.units[space.dim :]
    if not axes:
        raise InputError(argument, f"is {text!r}", "the map has no rotations")
    return _parse_numbers(text, argument, axes, units, f"it must be {','.join(axes)}")


def _parse_numbers(
    text: str, argument: str, axes: Sequence[str], units: Sequence[str], rule: str
) -> tuple[float, ...]:
    """Parse one number for each axis, separated by commas.

    An angle may have a unit. Raises InputError, with ``rule`` in its message, for other texts.
    """
    # Too few or too many numbers are a ValueError of zip.
    numbers = []
    try:
        for field, axis, unit in zip(_split_fields(text), axes, units, strict=True):
            if unit == "rad":
                numbers.append(parse_angle(field, argument, axis))
            else:
                numbers.append(float(field))
    except InputError:
        raise
    except ValueError:
        raise InputError(argument, f"is {text!r}", rule) from None
    return tuple(numbers)


def _split_fields(text: str) -> list[str]:
    """Split a text at the commas outside brackets."""
    return text.strip("()[] ").split(",")


def parse_offset(text: str) -> tuple[float, ...]:
    """Parse ``--offset``, a number for each axis; raise InputError otherwise."""
    dim = 3 if text.count(",") > 1 else 2
    rule = "it must be X,Y or, in space, X,Y,Z, metres"
    return _parse_numbers(text, "offset", "xyz"[:dim], ("m",) * dim, rule)


def parse_box(text: str, argument: str) -> tuple[float, ...]:
    """Parse the corners of a box, such as ``bounds``.

    Raises InputError if the text is not four numbers, or six in space, or if the box is empty.
    """
    try:
        values = tuple(map(float, _split_fields(text)))
    except ValueError:
        values = ()
    dim = len(values) // 2
    ascends = all(low < high for low, high in zip(values[:dim], values[dim:], strict=False))
    if len(values) not in (4, 6) or not ascends or not all(map(math.isfinite, values)):
        rule = "it must be XMIN,YMIN,XMAX,YMAX, metres, or six numbers in space, the lower first"
        raise InputError(argument, f"is {text!r}", rule)
    return values


def parse_angle(text: str, argument: str, name: str) -> float:
    """Parse an angle such as ``90deg`` or, in radians, ``1.57``.

    ``name`` is for messages. Raises InputError if the text is not an angle, or if it has no unit
    and exceeds 2 pi, because degrees were then probably intended.
    """
    word = text.strip()
    # The unit is at the end; without one it is "".
    unit = next((unit for unit in ("deg", "rad") if word.endswith(unit)), "")
    number = word.removesuffix(unit)
    problem = f"has the {name} {text!r}"
    try:
        value = float(number)
    except ValueError:
        rule = "it must be a number of degrees or radians"
        raise InputError(argument, problem, rule) from None
    if not unit and math.isfinite(value) and abs(value) > 2.0 * math.pi:
        rule = f"an angle without a unit is in radians, and {value:g} rad is more than a full turn"
        hint = f"write {number}deg for {number} degrees, or {number}rad"
        raise InputError(argument, problem, rule, hint)
    return math.radians(value) if unit == "deg" else value


def drop_unset(**options: Any) -> dict[str, Any]:
    """Drop options that are None, False or empty lists."""
    return {
        name: value
        for name, value in options.items()
        if value or not isinstance(value, bool | list | None)
    }
