"""Options: configurations, angles, boxes, and library messages in terms of options."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace.cli.options import parse_angle, parse_box, parse_configuration
from cspace.cli.report import format_error, show
from cspace.errors import CspaceError, FileError, InputError
from tests.helpers.commands import COMMANDS, flatten, run
from tests.helpers.refusals import refusals

AXES_OF = {
    "plane": ("x", "y"),
    "turning": ("x", "y", "yaw"),
    "space": ("x", "y", "z"),
    "both": ("x", "y", "z", "yaw"),
}
OPTION_NAMES = {"solid": "--solid", "spacing": "--spacing"}


def parse(text: str, kind: str) -> tuple[float, ...]:
    """Parse a start on a map of a kind."""
    units = ["rad" if axis == "yaw" else "m" for axis in AXES_OF[kind]]
    return parse_configuration(text, "start", AXES_OF[kind], units)


@pytest.mark.parametrize(
    ("text", "kind", "expected"),
    [
        ("1,-2", "plane", (1.0, -2.0)),
        ("1,-2, 90", "space", (1.0, -2.0, 90.0)),
        ("1,-2,90deg", "turning", (1.0, -2.0, math.pi / 2)),
        ("1,-2,0.5,-90deg", "both", (1.0, -2.0, 0.5, -math.pi / 2)),
    ],
)
def test_parse_configuration_reads_units(text: str, kind: str, expected: tuple[float, ...]) -> None:
    assert parse(text, kind) == expected


@pytest.mark.parametrize("kind", AXES_OF)
@pytest.mark.parametrize("text", ["1", "1,2,3,4,", "a,b", "a,b,1", "", "1,2,3,4,5"])
def test_invalid_configurations_are_refused_with_an_example(text: str, kind: str) -> None:
    with pytest.raises(InputError) as caught:
        parse(text, kind)
    assert str(caught.value).startswith(
        f"start is {text!r}; the map's configurations are {','.join(AXES_OF[kind])}, in"
    )
    example = str(caught.value).rpartition("start=")[2]
    assert len(parse(example, kind)) == len(AXES_OF[kind])


@pytest.mark.parametrize(
    ("text", "radians"),
    [
        *(
            ("0", 0.0),
            ("90deg", math.pi / 2),
            ("-90deg", -math.pi / 2),
            (" 450deg ", 2.5 * math.pi),
            ("1.57", 1.57),
        ),
        *(
            ("-6.28", -6.28),
            (str(2 * math.pi), 2 * math.pi),
            ("1e-3", 1e-3),
            ("1.5rad", 1.5),
            ("90rad", 90.0),
        ),
    ],
)
def test_angles_are_read_in_degrees_and_radians(text: str, radians: float) -> None:
    assert parse_angle(text, "yaw", "yaw") == pytest.approx(radians, abs=1e-15)


@given(st.floats(-1e6, 1e6))
def test_degrees_become_radians(value: float) -> None:
    assert parse_angle(f"{value!r}deg", "yaw", "yaw") == math.radians(value)


@refusals(
    "text, message",
    *[(text, rf"'{text}'.*write {text}deg for degrees") for text in ("90", "-180", "6.3", "360")],
    *[
        (text, rf"yaw has the yaw '{text}'.* write e\.g\. 90deg or 1\.57")
        for text in ("", "deg", "north", "90°", "1.57 deg deg", "90 degrees", "pi")
    ],
)
def test_angles_without_a_unit_and_other_texts_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        parse_angle(text, "yaw", "yaw")


def test_parse_box_reads_corners() -> None:
    assert parse_box("-1,0, 2,3", "bounds") == (-1.0, 0.0, 2.0, 3.0)
    assert parse_box("-1,0,0,2,3,1e1", "bounds") == (-1.0, 0.0, 0.0, 2.0, 3.0, 10.0)


@pytest.mark.parametrize("text", ["here", "0,0,1", "0,0,0,1,1", "0,0,0,1,1,nan", "0,0,0,1,-1,1"])
def test_parse_box_refuses_other_texts(text: str) -> None:
    with pytest.raises(InputError, match="bounds"):
        parse_box(text, "bounds")


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (
            InputError("spacing", "is -1", "it must be above zero", "pass it in metres"),
            "--spacing is -1; it must be above",
        ),
        (
            InputError("solid", "is 'x'", hint="pass solid='fill'"),
            "--solid is 'x'; pass --solid='fill'",
        ),
        (
            FileError("spacing=1.npy", "does not exist", "check the name"),
            "spacing=1.npy: does not exist; check the name",
        ),
        (CspaceError("a message with spacing=1 as a whole"), "a message with spacing=1 as a whole"),
    ],
)
def test_format_error_uses_the_fields_of_errors(error: CspaceError, expected: str) -> None:
    assert format_error(error, OPTION_NAMES).startswith(expected)


def test_the_list_of_commands_cuts_no_sentence() -> None:
    printed = flatten(run("--help").stdout)
    for name, command in COMMANDS.items():
        sentence = flatten(command.help).partition(". ")[0]
        assert f"{name} {sentence}" in printed


@pytest.mark.parametrize("name", ["clearance_m", "obstacle_distance_rad"])
def test_a_bound_of_zero_is_printed_as_not_proven(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    show({name: 0.0, "length_m": 0.0}, as_json=False)
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].endswith("not proven to be more than 0") and printed[1].endswith("0 m")
    show({name: 0.0}, as_json=True)
    assert json.loads(capsys.readouterr().out) == {name: 0.0}
