"""Options: configurations, angles, boxes, and library messages in terms of options."""

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace._cli.options import open_robot, parse_angle, parse_box, parse_configuration
from cspace._cli.report import format_error, show
from cspace.errors import CspaceError, FileError, InputError
from tests.helpers.commands import commands, flatten, run
from tests.helpers.refusals import refusals

AXES = ("x", "y", "yaw")
UNITS = ("m", "m", "rad")


@given(x=st.floats(-1e6, 1e6), degrees=st.floats(-1e6, 1e6), radians=st.floats(-6.28, 6.28))
def test_configurations_have_metres_degrees_and_radians(x, degrees, radians):
    assert parse_configuration(f"{x!r},-2", "start", AXES[:2], UNITS[:2]) == (x, -2.0)
    in_degrees = parse_configuration(f"0, {x!r}, {degrees!r}deg", "start", AXES, UNITS)
    assert in_degrees == (0.0, x, math.radians(degrees))
    assert parse_angle(f"{radians!r}", "yaw", "yaw") == radians
    assert parse_angle(f" {degrees!r}rad ", "yaw", "yaw") == degrees


def test_a_footprint_of_any_number_of_corners_is_a_robot():
    for count in (3, 6, 7, 8, 16, 17, 64):
        angles = [math.tau * k / count for k in range(count)]
        corners = [[0.3 * math.cos(angle), 0.3 * math.sin(angle)] for angle in angles]
        robot = open_robot(f"footprint:{corners}")
        assert robot.name == f"polygon with {count} corners"
        assert f"polygon with {count} corners" in run("info", f"footprint:{corners}").stdout


@pytest.mark.parametrize("text", ["1", "1,2,3,4,", "a,b,1", ""])
def test_invalid_configurations_are_refused(text):
    with pytest.raises(InputError, match=r"start .*configurations"):
        parse_configuration(text, "start", AXES, UNITS)


@refusals(
    "text, message",
    ("90", "write 90deg for 90 degrees"),
    ("-6.3", "write -6.3deg for -6.3 degrees"),
    ("deg", "yaw has the yaw 'deg'"),
    ("90 degrees", "yaw has the yaw '90 degrees'"),
)
def test_other_angles_are_refused(text, message):
    with pytest.raises(InputError, match=message):
        parse_angle(text, "yaw", "yaw")


def test_boxes_have_two_corners():
    assert parse_box("-1,0, 2,3", "bounds") == (-1.0, 0.0, 2.0, 3.0)
    assert parse_box("-1,0,0,2,3,1e1", "bounds") == (-1.0, 0.0, 0.0, 2.0, 3.0, 10.0)


@pytest.mark.parametrize("text", ["here", "0,0,1", "0,0,0,1,1", "0,0,0,1,1,nan", "0,0,0,1,-1,1"])
def test_other_boxes_are_refused(text):
    with pytest.raises(InputError, match="bounds"):
        parse_box(text, "bounds")


@pytest.mark.parametrize(
    "error, message",
    [
        (
            InputError("spacing", "is -1", "it must be above zero", "pass it in metres"),
            "--spacing is -1; it must be above zero; pass it in metres",
        ),
        (InputError("solid", "is 'x'", hint="pass solid='fill'"), "is 'x'; pass --solid='fill'"),
        (InputError("goal[0]", "is nan", hint="pass solid=True"), "goal[0] is nan; pass --solid"),
        (FileError("spacing=1.npy", "is not there"), "spacing=1.npy: is not there"),
        (CspaceError("a message with spacing=1 as a whole"), "a message with spacing=1 as a whole"),
    ],
)
def test_errors_name_options_instead_of_arguments(error, message):
    assert format_error(error, {"solid": "--solid", "spacing": "--spacing"}).endswith(message)


def test_the_list_of_commands_cuts_no_sentence():
    printed = flatten(run("--help").stdout)
    for name, command in commands().items():
        assert f"{name} {flatten(command.help).partition('. ')[0]}" in printed


def test_a_bound_of_zero_is_printed_as_not_proven(capsys):
    show({"clearance_m": 0.0, "length_m": 0.0, "height_m": math.inf}, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert lines == [
        "clearance  not proven to be more than 0",
        "length     0 m",
        "height     inf m",
    ]
    show({"clearance_m": 0.0, "height_m": math.inf}, as_json=True)
    assert json.loads(capsys.readouterr().out) == {"clearance_m": 0.0, "height_m": None}
