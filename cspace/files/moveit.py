"""MoveIt's messages, also as mappings or in YAML: tables of their fields, and parsers.

The YAML is what ROS prints, or what robowflex and MotionBenchMaker write. Fields that a message
does not have are refused, because a misspelled one would be lost. Fields that would change the
answer but are not read are refused too, unless they are empty.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, Final, TypeAlias

import numpy as np

from cspace.errors import InputError
from cspace.files.access import ContentError, decoding
from cspace.files.fields import Fields
from cspace.files.plain import read_yaml
from cspace.support.arrays import Floats

WORLD: Final = "world"
"""Frame of poses whose header names none, as in robowflex."""

SCENE_KIND: Final = "planning scene"
"""Kind of file, for messages."""

REQUEST_KIND: Final = "motion plan request"
"""Kind of file, for messages."""

MAX_POSITION_METRES: Final = 1e3
"""Largest coordinate of a position, metres.

There, rounding is 1e-13 m, less than :data:`cspace.bodies.DISTANCE_ROUNDING` at a metre: a pose in
a far frame may lead back to the arm.
"""

MAX_NUMBER: Final = 1e100
"""Largest number of a message."""

MOTION_ROUNDING: Final = 1e-6
"""Largest difference of the entries of two equal motions, metres and radians."""

FIELDS: Final = (
    Fields(
        "MoveIt planning scenes",
        honoured=(
            "`frame_id`",
            "poses",
            "`primitives`, `meshes`",
            "`attached_collision_objects`",
            "`allowed_collision_matrix`",
            "`joint_state`",
        ),
        refused=(
            "several frames",
            "transforms other than the identity",
            "`planes`, `subframe_names`, `octomap`",
            "`link_padding`, `link_scale`",
            "`is_diff`",
            "unknown fields",
        ),
        warned=("attached objects without an arm",),
    ),
    Fields(
        "MoveIt requests",
        honoured=("`start_state`", "joint, position and orientation constraints", "tolerances"),
        refused=("constraints of paths and visibility", "`target_point_offset`", "unknown fields"),
    ),
)

Parser: TypeAlias = Callable[[Any, str], Any]
"""Function of a value of YAML and its place in the file; raises ContentError if it is wrong."""

Schema: TypeAlias = "Parser | list[Schema] | dict[str, Schema]"
"""How :func:`parse` parses a value."""

PRIMITIVES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("x", "y", "z"),
    "sphere": ("radius",),
    "cylinder": ("height", "radius"),
    "cone": ("height", "radius"),
}
"""Dimensions of each primitive, in the order of the numbers of their types, which begin at 1."""

_NEUTRAL_FIELDS: Final = ("name", "header", "is_diff", "w")
"""Fields that messages without content may have; w is that of the quaternion of no rotation."""


# ---- parsers -------------------------------------------------------------------------------------


def wrong_value(value: Any, place: str, rule: str, hint: str = "correct it") -> ContentError:
    """Return the error for a value that breaks a rule."""
    return ContentError(f"has {repr(value)[:60]} as {place}", rule, hint)


def refuse(hint: str) -> Parser:
    """Make a parser of a field that must be empty."""

    def check(value: Any, place: str) -> None:
        if _holds_entries(value):
            raise ContentError(f"has {place}", "it is not read", hint)

    return check


def _holds_entries(value: Any) -> bool:
    """Return True if a message holds more than neutral fields and zeros."""
    if isinstance(value, Mapping):
        fields = (field for name, field in value.items() if name not in _NEUTRAL_FIELDS)
        return any(map(_holds_entries, fields))
    if isinstance(value, list):
        return any(entry != 0 for entry in value)
    return bool(value)


def accept_only(*accepted: Any, hint: str = "correct it") -> Parser:
    """Make a parser that accepts some values; a missing value is the first of them."""
    rule = f"it must be {' or '.join(map(repr, accepted))}"

    def check(value: Any, place: str) -> Any:
        if value is None:
            return accepted[0]
        # True == 1 in Python, but not in a message.
        is_flag = isinstance(value, bool)
        comparable = [choice for choice in accepted if isinstance(choice, bool) == is_flag]
        if value not in comparable:
            raise wrong_value(value, place, rule, hint)
        return value

    return check


def allow_missing(parser: Parser, default: Any) -> Parser:
    """Make a parser that returns a default for a missing value."""
    return lambda value, place: default if value is None else parser(value, place)


def parse(schema: Schema, value: Any, place: str) -> Any:
    """Parse a value of YAML.

    ``schema`` is the parser of one value, a list of the schema of all items, or a table of the
    schema of each field.
    """
    if callable(schema):
        return schema(value, place)
    if isinstance(schema, list):
        if not isinstance(value, list | None):
            raise wrong_value(value, place, "it must be a list")
        (item_schema,) = schema
        items = enumerate(value or ())
        return [parse(item_schema, item, f"{place}[{number}]") for number, item in items]
    if not isinstance(value, dict | None):
        raise wrong_value(value, place or "the top", "it must be a table of names and values")
    # A field that is missing is parsed as None, for which its parser has a default or an error.
    table = value or {}
    for name in table:
        if name not in schema and name not in _IGNORED_FIELDS:
            raise ContentError(
                f"has the unknown field {str(name)[:40]!r} at {place or 'the top'}",
                f"the fields are {', '.join(schema)}",
                "correct or remove it",
            )
    return {
        name: parse(field, table.get(name), f"{place}.{name}".lstrip("."))
        for name, field in schema.items()
    }


def allow_wrapped(field: str, schema: Schema) -> Parser:
    """Make a parser of a value that may be the only field of a table."""

    def parse_either(value: Any, place: str) -> Any:
        if isinstance(value, dict):
            return parse({field: schema}, value, place)[field]
        return parse(schema, value, place)

    return parse_either


def parse_name(value: Any, place: str) -> str:
    """Parse a name, which is not empty; robowflex omits the quotes of numbers."""
    name = str(value) if type(value) is int else value
    if not isinstance(name, str) or not name:
        raise wrong_value(value, place, "it must be a name")
    return name


def parse_names(value: Any, place: str) -> list[str]:
    """Parse a list of different names."""
    names: list[str] = parse([parse_name], value, place)
    for name, following in itertools.pairwise(sorted(names)):
        if name == following:
            raise ContentError(
                f"has {name[:40]!r} twice in {place}", "names must differ", "remove one"
            )
    return names


def parse_frame(value: Any, place: str) -> str:
    """Parse the name of a frame without the slash of old versions of ROS; it may be empty."""
    is_given = value or value == 0
    return parse_name(value, place).lstrip("/") if is_given else ""


def parse_number(value: Any, place: str) -> float:
    """Parse a finite number."""
    if type(value) not in (int, float) or not abs(value) < MAX_NUMBER:
        raise wrong_value(value, place, "it must be one finite number")
    return float(value)


def parse_tolerance(value: Any, place: str) -> float:
    """Parse a number that is not negative; a missing one is zero."""
    tolerance = 0.0 if value is None else parse_number(value, place)
    if tolerance < 0.0:
        raise wrong_value(value, place, "it may not be negative")
    return tolerance


def make_vector_parser(count: int) -> Parser:
    """Make a parser of a list of numbers, or of a table with x, y, z and w."""

    def parse_vector(value: Any, place: str) -> Floats:
        entries = value
        if isinstance(value, dict) and len(value) == count:
            entries = [value.get(name) for name in "xyzw"[:count]]
        if not isinstance(entries, list) or len(entries) != count:
            raise wrong_value(value, place, f"it must be {count} finite numbers")
        return np.array([parse_number(entry, place) for entry in entries])

    return parse_vector


_parse_position: Final = allow_missing(make_vector_parser(3), np.zeros(3))
_parse_quaternion: Final = allow_missing(make_vector_parser(4), np.array([0.0, 0.0, 0.0, 1.0]))
_POSE: Final[Schema] = {"position": _parse_position, "orientation": _parse_quaternion}
_TRANSFORM: Final[Schema] = {"translation": _parse_position, "rotation": _parse_quaternion}


def parse_pose(value: Any, place: str) -> Floats:
    """Parse a pose as a matrix, shape (4, 4); a missing pose is the identity."""
    fields = parse(_POSE, value, place)
    return _make_motion(fields["position"], fields["orientation"], place)


def parse_rotation(value: Any, place: str) -> Floats:
    """Parse a quaternion as a rotation matrix, shape (3, 3)."""
    return _make_motion(np.zeros(3), _parse_quaternion(value, place), place)[:3, :3]


def parse_identity(value: Any, place: str) -> None:
    """Refuse a transform that is not the identity."""
    fields = parse(_TRANSFORM, value, place)
    motion = _make_motion(fields["translation"], fields["rotation"], place)
    if np.abs(motion - np.eye(4)).max() > MOTION_ROUNDING:
        raise ContentError(
            f"has a motion as {place}",
            "frames are not transformed",
            "remove it; write poses in the planning frame, and pass base_pose= for the arm",
        )


def _make_motion(position: Floats, quaternion: Floats, place: str) -> Floats:
    """Return the matrix of a rigid motion, shape (4, 4).

    Like MoveIt, normalise the quaternion, x to w.
    """
    from scipy.spatial.transform import Rotation

    if np.abs(position).max() > MAX_POSITION_METRES:
        raise ContentError(
            f"has a position beyond {MAX_POSITION_METRES:g} m at {place}",
            "its digits would be lost",
            "use metres and a nearer frame",
        )
    motion = np.eye(4)
    motion[:3, 3] = position
    *imaginary, _ = quaternion
    if any(imaginary):  # else it is the identity, whatever its norm
        # Squares of tiny numbers would lose digits.
        scaled = quaternion / np.abs(quaternion).max()
        motion[:3, :3] = Rotation.from_quat(scaled).as_matrix()
    return motion


_PRIMITIVE: Final[Schema] = {
    "type": lambda value, place: value,
    "dimensions": [parse_number],
    "polygon": refuse("only prisms have one, and they are not read; write another primitive"),
}


def parse_primitive(value: Any, place: str) -> tuple[str, list[float]]:
    """Parse a ``shape_msgs/SolidPrimitive`` as its kind and its dimensions in metres."""
    fields = parse(_PRIMITIVE, value, place)
    kind = str(fields["type"]).lower()
    # Messages have the number of a kind, and files may have its name.
    names_by_number = {str(number): name for number, name in enumerate(PRIMITIVES, 1)}
    kind = names_by_number.get(kind, kind)
    if kind not in PRIMITIVES:
        choices = ", ".join(f"{name} ({number})" for number, name in names_by_number.items())
        raise wrong_value(fields["type"], f"{place}.type", f"it must be one of {choices}")
    names = PRIMITIVES[kind]
    sizes = fields["dimensions"]
    # Messages often pad dimensions to three numbers with zeros.
    used = sizes[: len(names)]
    padding = sizes[len(names) :]
    if len(used) < len(names) or any(padding) or min(used) <= 0.0:
        rule = f"a {kind} has {', '.join(names)}, metres above zero"
        raise wrong_value(sizes, f"{place}.dimensions", rule)
    return kind, used


def check_poses(fields: Mapping[str, Any], items: str, poses: str, place: str) -> list[Floats]:
    """Return the poses of a list of shapes; a single shape needs none."""
    matrices: list[Floats] = fields[poses]
    count = len(fields[items])
    if not matrices and count == 1:
        return [np.eye(4)]
    if len(matrices) != count:
        raise ContentError(
            f"has {count} {items} but {len(matrices)} {poses} at {place}",
            "each needs a pose",
            "add or remove some",
        )
    return matrices


# ---- messages ------------------------------------------------------------------------------------

_IGNORED_FIELDS: Final = (
    "seq",
    "stamp",
    "type",
    "name",
    "weight",
    "detach_posture",
    "velocity",
    "effort",
    "joint_names",
    "twist",
    "wrench",
    "binary",
    "id",
    "resolution",
    "child_frame_id",
    "robot_model_name",
    "object_colors",
    "parameterization",
    "workspace_parameters",
    "pipeline_id",
    "planner_id",
    "num_planning_attempts",
    "max_velocity_scaling_factor",
    "max_acceleration_scaling_factor",
    "cartesian_speed_end_effector_link",
    "cartesian_speed_limited_link",
    "max_cartesian_speed",
)
"""Fields of messages that change no answer; a schema that has one of them reads it."""

_HEADER: Final[Schema] = {"frame_id": parse_frame}

_MESH: Final[Schema] = {
    "triangles": [allow_wrapped("vertex_indices", [parse_number])],
    "vertices": [make_vector_parser(3)],
    "resource": allow_missing(parse_name, ""),
    "dimensions": allow_missing(make_vector_parser(3), None),
}

_refuse_planes: Final = refuse("a plane has no end; write a box")
_refuse_subframes: Final = refuse("remove them, and write poses in the planning frame")

_COLLISION_OBJECT: Final[Schema] = {
    "id": parse_name,
    "header": _HEADER,
    "pose": parse_pose,
    # ROS 2 prints the number as a byte.
    "operation": accept_only("add", "ADD", "", 0, "\0", hint="write the scene as it is"),
    "primitives": [parse_primitive],
    "primitive_poses": [parse_pose],
    "meshes": [_MESH],
    "mesh_poses": [parse_pose],
    "planes": _refuse_planes,
    "plane_poses": _refuse_planes,
    "subframe_names": _refuse_subframes,
    "subframe_poses": _refuse_subframes,
}

_ATTACHED_OBJECT: Final[Schema] = {
    "link_name": parse_name,
    "object": _COLLISION_OBJECT,
    "touch_links": [parse_name],
}

_STATE: Final[dict[str, Schema]] = {
    "joint_state": {"header": _HEADER, "name": parse_names, "position": [parse_number]},
    "multi_dof_joint_state": {"header": _HEADER, "transforms": [parse_identity]},
    "attached_collision_objects": [_ATTACHED_OBJECT],
    "is_diff": accept_only(False, hint="write the whole state"),
}

_FLAGS: Final[Schema] = [accept_only(False, True)]

_MATRIX: Final[Schema] = {
    "entry_names": parse_names,
    "entry_values": [allow_wrapped("enabled", _FLAGS)],
    "default_entry_names": parse_names,
    "default_entry_values": _FLAGS,
}

_OCTOMAP: Final[Schema] = {
    "header": _HEADER,
    "data": refuse("save it as .bt, and read it with Workspace.from_octomap"),
}

_USE_PADDING: Final = "remove it, and pass padding= to build_arm_space"

_SCENE: Final[Schema] = {
    "is_diff": accept_only(False, hint="write the whole scene"),
    "world": {
        "collision_objects": [_COLLISION_OBJECT],
        "octomap": {"header": _HEADER, "origin": parse_pose, "octomap": _OCTOMAP},
    },
    "robot_state": _STATE,
    "allowed_collision_matrix": _MATRIX,
    "fixed_frame_transforms": [{"header": _HEADER, "transform": parse_identity}],
    "link_padding": [{"link_name": parse_name, "padding": accept_only(0.0, hint=_USE_PADDING)}],
    "link_scale": [{"link_name": parse_name, "scale": accept_only(1.0, hint=_USE_PADDING)}],
}

_JOINT_CONSTRAINT: Final[Schema] = {
    "joint_name": parse_name,
    "position": parse_number,
    "tolerance_above": parse_tolerance,
    "tolerance_below": parse_tolerance,
}

_refuse_meshes: Final = refuse("write a box, a sphere or a cylinder")

_POSITION_CONSTRAINT: Final[Schema] = {
    "header": _HEADER,
    "link_name": parse_name,
    "target_point_offset": refuse("constrain the position of the link's origin"),
    "constraint_region": {
        "primitives": [parse_primitive],
        "primitive_poses": [parse_pose],
        "meshes": _refuse_meshes,
        "mesh_poses": _refuse_meshes,
    },
}

_parse_optional: Final = allow_missing(parse_number, 0.0)

_ORIENTATION_CONSTRAINT: Final[Schema] = {
    "header": _HEADER,
    "orientation": parse_rotation,
    "link_name": parse_name,
    "absolute_x_axis_tolerance": _parse_optional,
    "absolute_y_axis_tolerance": _parse_optional,
    "absolute_z_axis_tolerance": _parse_optional,
}

_refuse_unobeyed: Final = refuse("remove it; plans would not obey it")

_GOAL: Final[Schema] = {
    "joint_constraints": [_JOINT_CONSTRAINT],
    "position_constraints": [_POSITION_CONSTRAINT],
    "orientation_constraints": [_ORIENTATION_CONSTRAINT],
    "visibility_constraints": _refuse_unobeyed,
}

_REQUEST: Final[Schema] = {
    "group_name": parse_frame,
    "start_state": {
        **_STATE,
        "attached_collision_objects": refuse(
            "write them as attached_collision_objects of the scene's robot_state"
        ),
        "is_diff": accept_only(False, True),
    },
    "goal_constraints": [_GOAL],
    "path_constraints": _refuse_unobeyed,
    "trajectory_constraints": _refuse_unobeyed,
    "reference_trajectories": _refuse_unobeyed,
    "allowed_planning_time": _parse_optional,
}


def read_scene_message(source: object) -> Any:
    """Read the fields of a planning scene, or of its world alone."""
    content = _load(source, SCENE_KIND)
    if isinstance(content, dict) and "collision_objects" in content:
        content = {"world": content}
    with naming(source, SCENE_KIND):
        return parse(_SCENE, content, "")


def read_request_message(source: object) -> Any:
    """Read the fields of a motion plan request."""
    content = _load(source, REQUEST_KIND)
    with naming(source, REQUEST_KIND):
        return parse(_REQUEST, content, "")


def name_source(source: object, kind: str) -> str:
    """Return the path of a file, or the kind of a message."""
    return os.fspath(source) if isinstance(source, str | os.PathLike) else kind


@contextmanager
def naming(source: object, kind: str) -> Iterator[None]:
    """Turn a ContentError into a FileError, or into an InputError for a message."""
    if isinstance(source, str | os.PathLike):
        with decoding(source, kind):
            yield
        return
    try:
        yield
    except ContentError as error:
        raise InputError(kind, *error.parts) from error


def _load(source: object, kind: str) -> Any:
    """Return the plain value of a YAML file, a mapping or a message."""
    if isinstance(source, str | os.PathLike):
        return read_yaml(source, kind)
    return _convert_message(source)


def _convert_message(value: Any) -> Any:
    """Convert a message to tables, lists and plain values."""
    if isinstance(value, Mapping):
        return {name: _convert_message(field) for name, field in value.items()}
    if isinstance(value, bytes):  # ROS 2 has a byte as text of one character
        return value.decode("latin-1")
    if isinstance(value, str):
        return value
    if hasattr(value, "tolist"):  # an array of numpy or of Python
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_convert_message(item) for item in value]
    # The names of fields in ROS 2, in rosbags, and in ROS 1.
    if hasattr(value, "get_fields_and_field_types"):
        names = list(value.get_fields_and_field_types())
    elif dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
    else:
        names = list(getattr(value, "__slots__", ()))
    return {name: _convert_message(getattr(value, name)) for name in names} if names else value


def joint_values(state: Mapping[str, Any], place: str) -> dict[str, float]:
    """Return the values of joints in a parsed state of a robot."""
    names = state["joint_state"]["name"]
    positions = state["joint_state"]["position"]
    if len(names) != len(positions):
        raise ContentError(
            f"has {len(names)} joints but {len(positions)} positions at {place}",
            "each joint needs one",
            "add or remove some",
        )
    return dict(zip(names, positions, strict=True))


def find_frame(frames: set[str]) -> str:
    """Return the common frame of all poses.

    Raises ContentError if there are several.
    """
    if len(frames) > 1:
        raise ContentError(
            f"has poses in the frames {', '.join(map(repr, sorted(frames)))}",
            "they must be in one frame",
            "write them in the planning frame; an attached object may be in its link's frame",
        )
    return next(iter(frames), WORLD)
