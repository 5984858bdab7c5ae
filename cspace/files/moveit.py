"""Parts of MoveIt's messages in YAML: poses, frames, states of robots, and pairs that may touch.

The YAML is what ROS prints, or what robowflex and MotionBenchMaker write. Fields that a message
does not have are refused, because a misspelled one would be lost.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from cspace.arrays import Floats
from cspace.files.access import ContentError

WORLD: Final = "world"
"""Frame of poses whose header names none, as in robowflex."""

MAX_NAMES: Final = 10_000
"""Maximum number of names in an allowed collision matrix."""

MAX_POSITION_METRES: Final = 1e3
"""Largest coordinate of a position, metres.

There, rounding is 1e-13 m, less than :data:`cspace.exact.DISTANCE_ROUNDING` at a metre: a pose in a
far frame may lead back to the arm.
"""

_IDENTITY_QUATERNION: Final = (0.0, 0.0, 0.0, 1.0)

MOTION_ROUNDING: Final = 1e-6
"""Largest difference of the entries of two equal motions, metres and radians."""


class Contacts(NamedTuple):
    """Pairs that may touch, from an allowed collision matrix.

    Attributes
    ----------
    entries : mapping of pair of str to bool
        Pairs in alphabetical order.
    defaults : mapping of str to bool
    """

    entries: Mapping[tuple[str, str], bool]
    defaults: Mapping[str, bool]

    def may_touch(self, one: str, other: str) -> bool:
        """Return True if a pair may touch.

        Versions of MoveIt differ in what overrides what if an entry and a default disagree. A pair
        may touch only if its entry and the defaults of both names, as far as they exist, agree that
        it may.
        """
        pair = (one, other) if one < other else (other, one)
        given = [self.entries.get(pair), self.defaults.get(one), self.defaults.get(other)]
        return any(given) and False not in given


class RobotValues(NamedTuple):
    """A robot's state.

    Attributes
    ----------
    joints : dict of str to float
        Values of joints, radians or metres.
    attached : sequence of mapping
        Messages of attached objects.
    is_diff : bool
        Whether it only changes another state.
    """

    joints: dict[str, float]
    attached: Sequence[Mapping[str, Any]]
    is_diff: bool


def check_table(value: Any, place: str, fields: Collection[str] | None = None) -> Mapping[str, Any]:
    """Return a table, empty for None.

    Raises ContentError if it is none, or has a field other than `fields`.
    """
    if value is not None and not isinstance(value, dict):
        problem = f"has {str(value)[:40]!r} as {place}"
        raise ContentError(problem, "it must be a table of names and values", "correct it")
    for name in value or {}:
        if fields is not None and name not in fields:
            problem = f"has the unknown field {name[:40]!r} at {place}"
            raise ContentError(
                problem, f"the fields are {', '.join(fields)}", "correct or remove it"
            )
    return value or {}


def check_list(value: Any, place: str) -> Sequence[Any]:
    """Return a list, empty for None."""
    if value is not None and not isinstance(value, list):
        raise ContentError(f"has {str(value)[:40]!r} as {place}", "it must be a list", "correct it")
    return value or []


def parse_flag(value: Any, place: str) -> bool:
    """Return true or false; None is false."""
    if value is not None and not isinstance(value, bool):
        raise ContentError(
            f"has {str(value)[:40]} as {place}", "it must be true or false", "correct it"
        )
    return bool(value)


def parse_name(value: Any, place: str) -> str:
    """Return a name, which is not empty."""
    if not isinstance(value, str) or not value:
        hint = "add it" if not value else "put it in quotes"
        raise ContentError(
            f"has {str(value)[:40] if value else value!r} as {place}", "it must be a name", hint
        )
    return value


def parse_names(value: Any, place: str) -> list[str]:
    """Return a list of different names."""
    names = check_list(value, place)
    for name in names:
        if not isinstance(name, str) or not name:
            raise ContentError(
                f"has {str(name)[:40]!r} in {place}", "it must be a name", "correct it"
            )
    for name, following in zip(sorted(names), sorted(names)[1:], strict=False):
        if name == following:
            raise ContentError(
                f"has {name[:40]!r} twice in {place}", "names must differ", "remove one"
            )
    return list(names)


def parse_numbers(value: Any, count: int, place: str) -> Floats:
    """Parse numbers, shape (count,), from a list or table.

    A table holds x, y, z and w.
    """
    if isinstance(value, dict):
        value = [value.get(name) for name in "xyzw"[:count]] if len(value) == count else None
    if not isinstance(value, list) or len(value) != count or not all(map(_is_number, value)):
        raise ContentError(
            f"has {str(value)[:60]} as {place}", f"it must be {count} finite numbers", "correct it"
        )
    return np.array(value, dtype=np.float64)


def parse_number(value: Any, place: str, default: float) -> float:
    """Parse one number; None is the default."""
    if value is None:
        return default
    if not _is_number(value):
        raise ContentError(
            f"has {str(value)[:60]} as {place}", "it must be one finite number", "correct it"
        )
    return float(value)


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < 1e100


def parse_pose(value: Any, place: str) -> Floats:
    """Parse a pose as a rigid motion, shape (4, 4).

    The default is the identity. Like MoveIt, normalise quaternions.

    Raises ContentError if a number is missing, or the position is so far away that digits are lost.
    """
    table = check_table(value, place, ("position", "orientation"))
    given = table.get("position"), table.get("orientation")
    position = (
        np.zeros(3) if given[0] is None else parse_numbers(given[0], 3, f"position of {place}")
    )
    if np.abs(position).max() > MAX_POSITION_METRES:
        problem = f"has a position beyond {MAX_POSITION_METRES:g} m at {place}"
        raise ContentError(problem, "its digits would be lost", "use metres and a nearer frame")
    quaternion = np.array(_IDENTITY_QUATERNION)
    if given[1] is not None:
        quaternion = parse_numbers(given[1], 4, f"orientation of {place}")
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if quaternion[:3].any():
        from scipy.spatial.transform import Rotation

        # Squares of tiny numbers would lose digits.
        matrix[:3, :3] = Rotation.from_quat(quaternion / np.abs(quaternion).max()).as_matrix()
    return matrix


def parse_frame(entry: Mapping[str, Any], place: str) -> str:
    """Return the frame that the header of a message names."""
    header = check_table(
        entry.get("header"), f"the header of {place}", ("seq", "stamp", "frame_id")
    )
    frame = header.get("frame_id")
    if frame in (None, ""):
        return WORLD
    return (
        parse_name(frame, f"frame_id of {place}").lstrip("/") or WORLD
    )  # without the slash of old versions of ROS


def check_identity(value: Any, place: str, rule: str, hint: str) -> None:
    """Raise ContentError, with a rule and a hint, unless a transform is the identity."""
    motion = check_table(value, place, ("translation", "rotation"))
    pose = parse_pose(
        {"position": motion.get("translation"), "orientation": motion.get("rotation")}, place
    )
    if np.abs(pose - np.eye(4)).max() > MOTION_ROUNDING:
        raise ContentError(f"has a motion as {place}", rule, hint)


def parse_robot_state(value: Any, place: str) -> RobotValues:
    """Parse a ``moveit_msgs/RobotState``.

    Raises ContentError if names and positions do not match, or a joint with several degrees of
    freedom moves the robot.
    """
    fields = "joint_state", "multi_dof_joint_state", "attached_collision_objects", "is_diff"
    state = check_table(value, place, fields)
    joints = check_table(
        state.get("joint_state"),
        f"joint_state of {place}",
        ("header", "name", "position", "velocity", "effort"),
    )
    parse_frame(joints, f"joint_state of {place}")
    names = parse_names(joints.get("name"), f"the joints of {place}")
    given = check_list(joints.get("position"), f"the positions of {place}")
    if len(given) != len(names):
        problem = f"has {len(names)} joints but {len(given)} positions at {place}"
        raise ContentError(problem, "each joint needs one", "add or remove some")
    values = parse_numbers(list(given), len(names), f"positions of {place}").tolist()
    floating = check_table(
        state.get("multi_dof_joint_state"),
        f"multi_dof_joint_state of {place}",
        ("header", "joint_names", "transforms", "twist", "wrench"),
    )
    parse_frame(floating, f"multi_dof_joint_state of {place}")
    several = parse_names(floating.get("joint_names"), f"joint_names of {place}")
    transforms = check_list(floating.get("transforms"), f"transforms of {place}")
    if len(several) != len(transforms):
        problem = (
            f"has {len(several)} joint_names but {len(transforms)} transforms at "
            f"multi_dof_joint_state of {place}"
        )
        raise ContentError(problem, "each joint needs one", "add or remove some")
    for number, item in enumerate(transforms):
        here = f"transform {number} of multi_dof_joint_state of {place}"
        check_identity(
            item,
            here,
            "an arm's base is fixed",
            "remove it, and pass base_pose= to build_arm_space",
        )
    attached = check_list(
        state.get("attached_collision_objects"), f"attached_collision_objects of {place}"
    )
    tables = [
        check_table(each, f"attached_collision_objects[{number}]")
        for number, each in enumerate(attached)
    ]
    is_diff = parse_flag(state.get("is_diff"), f"is_diff of {place}")
    return RobotValues(dict(zip(names, values, strict=True)), tables, is_diff)


def parse_contacts(value: Any) -> Contacts | None:
    """Parse an allowed collision matrix; None if it is missing or empty."""
    place = "allowed_collision_matrix"
    fields = "entry_names", "entry_values", "default_entry_names", "default_entry_values"
    table = check_table(value, place, fields)
    names = parse_names(table.get("entry_names"), f"entry_names of {place}")
    if len(names) > MAX_NAMES:
        raise ContentError(
            f"has {len(names)} names in {place}", f"at most {MAX_NAMES} are read", "remove some"
        )
    rows = [
        _parse_row(row, names, place)
        for row in check_list(table.get("entry_values"), f"entry_values of {place}")
    ]
    if len(rows) != len(names):
        raise ContentError(
            f"has {len(rows)} rows but {len(names)} names in {place}", "it is square", "correct it"
        )
    matrix = np.array(rows, dtype=np.bool_).reshape(len(names), len(names))
    if (matrix != matrix.T).any():
        i, j = np.argwhere(matrix != matrix.T)[0].tolist()
        problem = f"lets {names[i]!r} touch {names[j]!r}, or not, in {place}"
        raise ContentError(problem, "it must be symmetric", "make both entries equal")
    order = sorted(range(len(names)), key=names.__getitem__)
    entries = {
        (names[i], names[j]): bool(matrix[i, j])
        for k, i in enumerate(order)
        for j in order[k + 1 :]
    }
    default_names = parse_names(table.get("default_entry_names"), f"default_entry_names of {place}")
    defaults = _parse_row(table.get("default_entry_values"), default_names, place)
    if not names and not default_names:
        return None
    return Contacts(entries, dict(zip(default_names, defaults, strict=True)))


def _parse_row(value: Any, names: Sequence[str], place: str) -> list[bool]:
    """Parse a row of a matrix: a list of booleans, or ROS's table of them."""
    if isinstance(value, dict):
        value = check_table(value, f"a row of {place}", ("enabled",)).get("enabled")
    row = check_list(value, f"a row of {place}")
    if len(row) != len(names) or not all(isinstance(each, bool) for each in row):
        problem, rule = (
            f"has {str(list(row))[:60]} as a row of {place}",
            f"it must be {len(names)} of true and false",
        )
        raise ContentError(problem, rule, "correct it")
    return list(row)


def refuse_link_values(value: Any, name: str, field: str, neutral: float, hint: str) -> None:
    """Raise ContentError if the padding or the scale of a link is not neutral."""
    for number, item in enumerate(check_list(value, name)):
        place = f"{name}[{number}]"
        entry = check_table(item, place, ("link_name", field))
        given = parse_number(entry.get(field), f"{field} of {place}", neutral)
        if given != neutral:
            problem = f"has the {field} {given:g} of {entry.get('link_name')!r} at {place}"
            raise ContentError(problem, "links keep their size", hint)
