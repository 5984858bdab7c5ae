"""MoveIt's messages, also as mappings or in YAML: tables of their fields, and parsers.

ROS prints the YAML; robowflex and MotionBenchMaker write it. Fields that a message
does not have are refused, because a misspelled one would be lost. Fields that would change the
answer but are not read are refused too, unless they are empty.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any, Final, TypeAlias

import numpy as np

from cspace.arms._checks import check_distinct
from cspace.errors import AngleWarning
from cspace.inside import ContentError, Fields, Floats, Ledger, warn_user

WORLD: Final = "world"
"""Frame of poses whose header names none, as in robowflex."""

FIELDS: Final = (
    Fields(
        "MoveIt planning scenes",
        honoured=(
            "`frame_id`; poses; `primitives`, `meshes`; `attached_collision_objects`; "
            "`allowed_collision_matrix`; `joint_state`"
        ),
        refused=(
            "several frames; transforms other than the identity; `planes`, `subframe_names`, "
            "`octomap`; `link_padding`, `link_scale`; `is_diff`; unknown fields"
        ),
        warned="attached objects without an arm",
        harmless="seq stamp type name weight detach_posture velocity effort joint_names twist "
        "wrench binary id resolution child_frame_id robot_model_name object_colors "
        "parameterization workspace_parameters pipeline_id planner_id num_planning_attempts "
        "max_velocity_scaling_factor max_acceleration_scaling_factor "
        "cartesian_speed_end_effector_link cartesian_speed_limited_link max_cartesian_speed",
    ),
    Fields(
        "MoveIt requests",
        honoured=(
            "`start_state`; joint, position and orientation constraints; tolerances; "
            "orientations of `path_constraints`"
        ),
        refused=("other constraints of paths; visibility; `target_point_offset`; unknown fields"),
    ),
)

Parser: TypeAlias = Callable[[Any, str], Any]
"""Function of a value of YAML and its place in the file; raises ContentError if it is wrong."""

Schema: TypeAlias = "Parser | list[Schema] | dict[str, Schema]"
"""How :func:`parse` parses a value."""

Pairs: TypeAlias = list[tuple[Any, Any]]
"""Items with their partners, such as shapes with their poses."""

Contacts: TypeAlias = dict[tuple[str, ...], bool]
"""Entries of an allowed collision matrix by two names, and defaults by one name."""

PRIMITIVES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("x", "y", "z"),
    "sphere": ("radius",),
    "cylinder": ("height", "radius"),
    "cone": ("height", "radius"),
}
"""Dimensions of each primitive, in the order of the numbers of their types, which begin at 1."""

_MAX_LEVELS: Final = 64
"""Maximum depth of nested fields."""

_NEUTRAL_FIELDS: Final = frozenset({"name", "header", "is_diff", "w"})
"""Fields that messages without content may have; w is that of the quaternion of no rotation."""


# ---- parsers -------------------------------------------------------------------------------------


def wrong_value(value: Any, place: str, rule: str) -> ContentError:
    """Make the error for a forbidden value."""
    return ContentError(f"has {repr(value)[:60]} as {place}", rule)


def refuse(value: Any, place: str) -> None:
    """Parse an empty field."""
    if _holds_entries(value):
        raise ContentError(f"has {place}", "it is not read")


def _holds_entries(value: Any, levels: int = _MAX_LEVELS) -> bool:
    """Return True if a message holds entries, or too many levels."""
    fields = Ledger.list_fields(value)
    if fields is not None:
        names = fields.keys() - _NEUTRAL_FIELDS
        return levels == 0 or any(_holds_entries(fields[name], levels - 1) for name in names)
    if isinstance(value := _make_plain(value), list):
        return any(entry != 0 for entry in value)
    return bool(value)


def accept_only(*accepted: Any) -> Parser:
    """Make a parser that accepts some values; the first is the default."""
    rule = f"it must be {' or '.join(map(repr, accepted))}"

    def check(value: Any, place: str) -> Any:
        if value is None:
            return accepted[0]
        # True == 1 in Python, but not in a message.
        kinds = [isinstance(choice, bool) for choice in accepted if choice == value]
        if isinstance(value, bool) not in kinds:
            raise wrong_value(value, place, rule)
        return value

    return check


def allow_missing(parser: Parser, default: Any) -> Parser:
    """Make a parser that returns a default for a missing value."""
    return lambda value, place: default if value is None else parser(value, place)


def parse(schema: Schema, value: Any, place: str) -> Any:
    """Parse a value of YAML.

    ``schema`` is the parser of one value, a list of the schema of all items, or a table of the
    schema of each field. A list may stand for a table of which it is the only field. Tables become
    objects with their fields as attributes.
    """
    value = _make_plain(value)
    if callable(schema):
        return schema(value, place)
    if isinstance(schema, list):
        if not isinstance(value, list | None):
            raise wrong_value(value, place, "it must be a list")
        (item_schema,) = schema
        items = enumerate(value or ())
        return [parse(item_schema, item, f"{place}[{number}]") for number, item in items]
    if isinstance(value, list) and len(schema) == 1:
        value = dict.fromkeys(schema, value)
    # A field that is missing is parsed as None, for which its parser has a default or an error.
    table = Ledger({} if value is None else value, place, _make_format(tuple(schema)))
    fields = {
        name: parse(field, table.get(name), f"{place}.{name}") for name, field in schema.items()
    }
    table.close(place)
    return SimpleNamespace(**fields)


@cache
def _make_format(names: tuple[str, ...]) -> Fields:
    """Make a table's format, which refuses other fields."""
    honoured = " ".join(f"`{name}`" for name in names)
    return Fields("MoveIt's messages", honoured, "unknown fields", harmless=FIELDS[0].harmless)


def _make_plain(value: Any) -> Any:
    """Return arrays and tuples as lists, and ROS bytes as text."""
    if hasattr(value, "tolist"):  # of numpy or of Python
        return value.tolist()
    if isinstance(value, bytes):
        return value.decode("latin-1")
    return list(value) if isinstance(value, tuple) else value


def parse_name(value: Any, place: str) -> str:
    """Parse a name that is not empty, also one without quotes."""
    name = str(value) if type(value) is int else value
    if not isinstance(name, str) or not name:
        raise wrong_value(value, place, "it must be a name")
    return name


def parse_names(value: Any, place: str) -> list[str]:
    """Parse a list of different names."""
    names: list[str] = parse([parse_name], value, place)
    check_distinct(names, f" in {place}")
    return names


def parse_frame(value: Any, place: str) -> str:
    """Parse a frame's name, or "", without an old version's slash."""
    return "" if value in (None, "") else parse_name(value, place).lstrip("/")


def parse_number(value: Any, place: str) -> float:
    """Parse a finite number."""
    return Ledger.check_value(place, "value", value)


def make_vector_parser(count: int) -> Parser:
    """Make a parser of numbers, or of x, y, z and w."""

    def parse_vector(value: Any, place: str) -> Floats:
        names = "xyzw"[:count]
        if Ledger.list_fields(value, names) is not None:
            numbers = parse(dict.fromkeys(names, parse_number), value, place)
            return np.array([getattr(numbers, name) for name in names])
        if not isinstance(value, list) or len(value) != count:
            raise wrong_value(value, place, f"it must be {count} finite numbers")
        return np.array([parse_number(entry, place) for entry in value])

    return parse_vector


_parse_vector: Final = make_vector_parser(3)
_parse_quaternion: Final = make_vector_parser(4)


def _parse_position(value: Any, place: str) -> Floats:
    """Parse a position, shape (3,); a missing one is the origin."""
    position: Floats = np.zeros(3) if value is None else _parse_vector(value, place)
    # Largest coordinate of a position, metres. There, rounding is 1e-13 m, less than the rounding
    # of a distance of a metre (:data:`cspace._bodies.DISTANCE_ROUNDING`): a pose in a
    # far frame may lead back to the arm.
    max_position_metres = 1e3
    if np.abs(position).max() > max_position_metres:
        raise ContentError(
            f"has a position beyond {max_position_metres:g} m at {place}",
            "its digits would be lost",
        )
    return position


def parse_rotation(value: Any, place: str) -> Floats:
    """Parse a quaternion (x, y, z, w) as a rotation matrix (3, 3).

    A missing one is the identity. Like MoveIt, normalise it.
    """
    from scipy.spatial.transform import Rotation

    quaternion = None if value is None else _parse_quaternion(value, place)
    if quaternion is None or not quaternion[:3].any():  # the identity, whatever the norm
        return np.eye(3)
    # Squares of tiny numbers would lose digits.
    largest = np.abs(quaternion).max()
    scaled = quaternion / largest
    # Largest component of a quaternion that was rounded to few digits.
    if largest > 1.01:
        warn_user(
            f"{place}: a quaternion has the component {largest:g}, beyond 1, and is scaled to norm "
            "1 as in MoveIt",
            AngleWarning,
        )
    return np.asarray(Rotation.from_quat(scaled).as_matrix())


def parse_pose(
    value: Any, place: str, position: str = "position", rotation: str = "orientation"
) -> Floats:
    """Parse a pose as a matrix (4, 4), by default the identity."""
    fields = parse({position: _parse_position, rotation: parse_rotation}, value, place)
    pose = np.eye(4)
    pose[:3, 3] = getattr(fields, position)
    pose[:3, :3] = getattr(fields, rotation)
    return pose


def parse_identity(value: Any, place: str) -> None:
    """Refuse a transform that is not the identity."""
    motion = parse_pose(value, place, "translation", "rotation")
    # Largest difference of the entries of two equal motions, metres and radians.
    if np.abs(motion - np.eye(4)).max() > 1e-6:
        raise ContentError(
            f"has a motion as {place}",
            "poses are in the planning frame, because frames are not transformed",
        )


_PRIMITIVE: Final[Schema] = {
    "type": parse_name,
    "dimensions": [parse_number],
    "polygon": refuse,
}


def parse_primitive(value: Any, place: str) -> tuple[str, list[float]]:
    """Parse a ``shape_msgs/SolidPrimitive`` as its kind and its dimensions in metres."""
    fields = parse(_PRIMITIVE, value, place)
    # Messages have the number of a kind, and files may have its name.
    names_by_number = {str(number): name for number, name in enumerate(PRIMITIVES, 1)}
    kind = names_by_number.get(fields.type, fields.type.lower())
    if kind not in PRIMITIVES:
        choices = ", ".join(f"{name} ({number})" for number, name in names_by_number.items())
        raise wrong_value(fields.type, f"{place}.type", f"it must be one of {choices}")
    names = PRIMITIVES[kind]
    # Messages often pad dimensions to three numbers with zeros.
    sizes = fields.dimensions[: len(names)]
    padding = fields.dimensions[len(names) :]
    if len(sizes) < len(names) or any(padding) or min(sizes) <= 0.0:
        rule = f"a {kind} has {', '.join(names)}, metres above zero"
        raise wrong_value(fields.dimensions, f"{place}.dimensions", rule)
    return kind, sizes


def pair_poses(fields: Any, items: str, poses: str, place: str) -> Pairs:
    """Pair shapes with poses; a single shape needs none."""
    lists = {name: getattr(fields, name) for name in (items, poses)}
    if len(lists[items]) == 1 and not lists[poses]:
        lists[poses] = [np.eye(4)]
    return pair_items(lists, place, "each needs a pose")


def pair_items(lists: Mapping[str, list[Any]], place: str, rule: str) -> Pairs:
    """Pair the items of two lists, named in messages."""
    items, partners = lists.values()
    if len(items) != len(partners):
        counts = " but ".join(f"{len(entries)} {name}" for name, entries in lists.items())
        raise ContentError(f"has {counts} at {place}", rule)
    return list(zip(items, partners, strict=True))


# ---- messages ------------------------------------------------------------------------------------

HEADER: Final[Schema] = {"frame_id": parse_frame}
"""Schema of the header of a pose."""

_MESH: Final[Schema] = {
    "triangles": [{"vertex_indices": [parse_number]}],
    "vertices": [_parse_vector],
    "resource": allow_missing(parse_name, ""),
    "dimensions": allow_missing(_parse_vector, None),
}


_COLLISION_OBJECT: Final[Schema] = {
    "id": parse_name,
    "header": HEADER,
    "pose": parse_pose,
    # ROS 2 prints the number as a byte.
    "operation": accept_only("add", "ADD", "", 0, "\0"),
    "primitives": [parse_primitive],
    "primitive_poses": [parse_pose],
    "meshes": [_MESH],
    "mesh_poses": [parse_pose],
    "planes": refuse,
    "plane_poses": refuse,
    "subframe_names": refuse,
    "subframe_poses": refuse,
}

_ATTACHED_OBJECT: Final[Schema] = {
    "link_name": parse_name,
    "object": _COLLISION_OBJECT,
    "touch_links": [parse_name],
}

_JOINT_STATE: Final[Schema] = {
    "header": HEADER,
    "name": parse_names,
    "position": [parse_number],
}


def _parse_joints(value: Any, place: str) -> dict[str, float]:
    """Parse the values of joints by their names."""
    fields = parse(_JOINT_STATE, value, place)
    lists = {"joints": fields.name, "positions": fields.position}
    return dict(pair_items(lists, place, "each joint needs one"))


def read_joint_state(fields: Mapping[str, Any], name: str) -> dict[str, float]:
    """Return the positions of a ``sensor_msgs/JointState`` by joint; errors call it ``name``."""
    with Ledger.reading(fields, "joint state", name, FIELDS[0]) as (_, state):
        state.skip()  # its ledger is another
        return _parse_joints(state.fields, name)


STATE: Final[dict[str, Schema]] = {
    "joint_state": _parse_joints,
    "multi_dof_joint_state": {"header": HEADER, "transforms": [parse_identity]},
    "attached_collision_objects": [_ATTACHED_OBJECT],
    "is_diff": accept_only(False),
}
"""Schema of the state of a robot."""

_FLAGS: Final[Schema] = [accept_only(False, True)]

_MATRIX: Final[Schema] = {
    "entry_names": parse_names,
    "entry_values": [{"enabled": _FLAGS}],
    "default_entry_names": parse_names,
    "default_entry_values": _FLAGS,
}


def _parse_contacts(value: Any, place: str) -> Contacts | None:
    """Parse an allowed collision matrix, or None if empty."""
    fields = parse(_MATRIX, value, place)
    names = fields.entry_names
    rows = [row.enabled for row in fields.entry_values]
    default_names = fields.default_entry_names
    defaults = fields.default_entry_values
    is_square = [len(row) for row in rows] == [len(names)] * len(names)
    if not is_square or len(default_names) != len(defaults):
        raise ContentError(
            f"has an {place} of another size than its names",
            "it is square, with a default for each name",
        )
    pairs = itertools.product(names, repeat=2)
    contacts: Contacts = dict(zip(pairs, itertools.chain(*rows), strict=True))
    # The default of a name is an entry of that name alone.
    contacts |= zip(zip(default_names, strict=True), defaults, strict=True)
    return contacts or None


_OCTOMAP: Final[Schema] = {
    "header": HEADER,
    "data": refuse,
}

SCENE: Final[Schema] = {
    "is_diff": accept_only(False),
    "world": {
        "collision_objects": [_COLLISION_OBJECT],
        "octomap": {"header": HEADER, "origin": parse_pose, "octomap": _OCTOMAP},
    },
    "robot_state": STATE,
    "allowed_collision_matrix": _parse_contacts,
    "fixed_frame_transforms": [{"header": HEADER, "transform": parse_identity}],
    "link_padding": [{"link_name": parse_name, "padding": accept_only(0.0)}],
    "link_scale": [{"link_name": parse_name, "scale": accept_only(1.0)}],
}
"""Schema of a planning scene."""


def find_frame(frames: set[str]) -> str:
    """Return the common frame of all poses.

    Raises ContentError if there are several.
    """
    if len(frames) > 1:
        raise ContentError(
            f"has poses in the frames {', '.join(map(repr, sorted(frames)))}",
            "they must be in one frame",
        )
    return next(iter(frames), WORLD)
