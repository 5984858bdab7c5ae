"""MoveIt's messages in YAML: tables of their fields, and parsers.

The YAML is what ROS prints, or what robowflex and MotionBenchMaker write. Fields that a message
does not have are refused, because a misspelled one would be lost. Fields that would change the
answer but are not read are refused too, unless they are empty.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np

from cspace.files.access import ContentError, decoding
from cspace.files.plain import read_yaml
from cspace.support.arrays import Floats, StrPath

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

Parser: TypeAlias = Callable[[Any, str], Any]
"""Function of a value of YAML and its place in the file; raises ContentError if it is wrong."""

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


def ignored(value: Any, place: str) -> Any:
    """Return a value that changes no answer."""
    return value


def refused(hint: str) -> Parser:
    """Make a parser of a field that must be empty."""

    def parse(value: Any, place: str) -> None:
        if _holds_entries(value):
            raise ContentError(f"has {place}", "it is not read", hint)

    return parse


def _holds_entries(value: Any) -> bool:
    """Return True if a message holds more than neutral fields and zeros."""
    if isinstance(value, Mapping):
        fields = (field for name, field in value.items() if name not in _NEUTRAL_FIELDS)
        return any(map(_holds_entries, fields))
    if isinstance(value, list):
        return any(entry != 0 for entry in value)
    return bool(value)


def only(*accepted: Any, hint: str = "correct it") -> Parser:
    """Make a parser that accepts some values; a missing value is the first of them."""
    rule = f"it must be {' or '.join(map(repr, accepted))}"

    def parse(value: Any, place: str) -> Any:
        if value is None:
            return accepted[0]
        # True == 1 in Python, but not in a message.
        is_flag = isinstance(value, bool)
        comparable = [choice for choice in accepted if isinstance(choice, bool) == is_flag]
        if value not in comparable:
            raise wrong_value(value, place, rule, hint)
        return value

    return parse


def optional(parser: Parser, default: Any) -> Parser:
    """Make a parser that returns a default for a missing value."""
    return lambda value, place: default if value is None else parser(value, place)


def table(fields: Mapping[str, Parser]) -> Parser:
    """Make a parser of a table that has no other fields."""

    def parse(value: Any, place: str) -> dict[str, Any]:
        if not isinstance(value, dict | None):
            raise wrong_value(value, place or "the file", "it must be a table of names and values")
        given = value or {}
        for name in given:
            if name not in fields:
                raise ContentError(
                    f"has the unknown field {str(name)[:40]!r} at {place or 'the top'}",
                    f"the fields are {', '.join(fields)}",
                    "correct or remove it",
                )
        return {
            name: parser(given.get(name), f"{place}.{name}".lstrip("."))
            for name, parser in fields.items()
        }

    return parse


def list_of(parser: Parser) -> Parser:
    """Make a parser of a list; a missing list is empty."""

    def parse(value: Any, place: str) -> list[Any]:
        if not isinstance(value, list | None):
            raise wrong_value(value, place, "it must be a list")
        return [parser(item, f"{place}[{number}]") for number, item in enumerate(value or ())]

    return parse


def unwrapped(field: str, parser: Parser) -> Parser:
    """Make a parser of a value that may be the only field of a table."""
    wrapped = table({field: parser})

    def parse(value: Any, place: str) -> Any:
        if isinstance(value, dict):
            return wrapped(value, place)[field]
        return parser(value, place)

    return parse


def parse_name(value: Any, place: str) -> str:
    """Parse a name, which is not empty; robowflex omits the quotes of numbers."""
    name = str(value) if type(value) is int else value
    if not isinstance(name, str) or not name:
        raise wrong_value(value, place, "it must be a name")
    return name


def parse_names(value: Any, place: str) -> list[str]:
    """Parse a list of different names."""
    names: list[str] = list_of(parse_name)(value, place)
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


def numbers(count: int) -> Parser:
    """Make a parser of a list of numbers, or of a table with x, y, z and w."""

    def parse(value: Any, place: str) -> Floats:
        entries = value
        if isinstance(value, dict) and len(value) == count:
            entries = [value.get(name) for name in "xyzw"[:count]]
        if not isinstance(entries, list) or len(entries) != count:
            raise wrong_value(value, place, f"it must be {count} finite numbers")
        return np.array([parse_number(entry, place) for entry in entries])

    return parse


_POSITION: Final = optional(numbers(3), np.zeros(3))
_QUATERNION: Final = optional(numbers(4), np.array([0.0, 0.0, 0.0, 1.0]))
_POSE: Final = table({"position": _POSITION, "orientation": _QUATERNION})
_TRANSFORM: Final = table({"translation": _POSITION, "rotation": _QUATERNION})


def parse_pose(value: Any, place: str) -> Floats:
    """Parse a pose as a matrix, shape (4, 4); a missing pose is the identity."""
    fields = _POSE(value, place)
    return _make_motion(fields["position"], fields["orientation"], place)


def parse_rotation(value: Any, place: str) -> Floats:
    """Parse a quaternion as a rotation matrix, shape (3, 3)."""
    return _make_motion(np.zeros(3), _QUATERNION(value, place), place)[:3, :3]


def parse_identity(value: Any, place: str) -> None:
    """Refuse a transform that is not the identity."""
    fields = _TRANSFORM(value, place)
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
    if quaternion[:3].any():
        # Squares of tiny numbers would lose digits.
        scaled = quaternion / np.abs(quaternion).max()
        motion[:3, :3] = Rotation.from_quat(scaled).as_matrix()
    return motion


_PRIMITIVE: Final = table(
    {
        "type": ignored,
        "dimensions": list_of(parse_number),
        "polygon": refused("only prisms have one, and they are not read; write another primitive"),
    }
)


def parse_primitive(value: Any, place: str) -> tuple[str, list[float]]:
    """Parse a ``shape_msgs/SolidPrimitive`` as its kind and its dimensions in metres."""
    fields = _PRIMITIVE(value, place)
    kind = str(fields["type"]).lower()
    numbered = {str(number): name for number, name in enumerate(PRIMITIVES, 1)}
    kind = numbered.get(kind, kind)
    if kind not in PRIMITIVES:
        known = ", ".join(f"{name} ({number})" for number, name in numbered.items())
        raise wrong_value(fields["type"], f"{place}.type", f"it must be one of {known}")
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

_HEADER: Final = table({"seq": ignored, "stamp": ignored, "frame_id": parse_frame})

_MESH: Final = table(
    {
        "triangles": list_of(unwrapped("vertex_indices", list_of(parse_number))),
        "vertices": list_of(numbers(3)),
        "resource": optional(parse_name, ""),
        "dimensions": optional(numbers(3), None),
    }
)

_NO_PLANES: Final = refused("a plane has no end; write a box")
_NO_SUBFRAMES: Final = refused("remove them, and write poses in the planning frame")

_COLLISION_OBJECT: Final = table(
    {
        "id": parse_name,
        "header": _HEADER,
        "pose": parse_pose,
        "type": ignored,
        # ROS 2 prints the number as a byte.
        "operation": only("add", "ADD", "", 0, "\0", hint="write the scene as it is"),
        "primitives": list_of(parse_primitive),
        "primitive_poses": list_of(parse_pose),
        "meshes": list_of(_MESH),
        "mesh_poses": list_of(parse_pose),
        "planes": _NO_PLANES,
        "plane_poses": _NO_PLANES,
        "subframe_names": _NO_SUBFRAMES,
        "subframe_poses": _NO_SUBFRAMES,
    }
)

_ATTACHED_OBJECT: Final = table(
    {
        "link_name": parse_name,
        "object": _COLLISION_OBJECT,
        "touch_links": list_of(parse_name),
        "detach_posture": ignored,
        "weight": ignored,
    }
)

_STATE_FIELDS: Final = {
    "joint_state": table(
        {
            "header": _HEADER,
            "name": parse_names,
            "position": list_of(parse_number),
            "velocity": ignored,
            "effort": ignored,
        }
    ),
    "multi_dof_joint_state": table(
        {
            "header": _HEADER,
            "joint_names": ignored,
            "transforms": list_of(parse_identity),
            "twist": ignored,
            "wrench": ignored,
        }
    ),
    "attached_collision_objects": list_of(_ATTACHED_OBJECT),
    "is_diff": only(False, hint="write the whole state"),
}

_FLAGS: Final = list_of(only(False, True))

_MATRIX: Final = table(
    {
        "entry_names": parse_names,
        "entry_values": list_of(unwrapped("enabled", _FLAGS)),
        "default_entry_names": parse_names,
        "default_entry_values": _FLAGS,
    }
)

_OCTOMAP: Final = table(
    {
        "header": _HEADER,
        "binary": ignored,
        "id": ignored,
        "resolution": ignored,
        "data": refused("save it as .bt, and read it with Workspace.from_octomap"),
    }
)

_FIXED_TRANSFORM: Final = table(
    {"header": _HEADER, "child_frame_id": ignored, "transform": parse_identity}
)

_USE_PADDING: Final = "remove it, and pass padding= to build_arm_space"

_SCENE: Final = table(
    {
        "name": ignored,
        "robot_model_name": ignored,
        "object_colors": ignored,
        "is_diff": only(False, hint="write the whole scene"),
        "world": table(
            {
                "collision_objects": list_of(_COLLISION_OBJECT),
                "octomap": table({"header": _HEADER, "origin": parse_pose, "octomap": _OCTOMAP}),
            }
        ),
        "robot_state": table(_STATE_FIELDS),
        "allowed_collision_matrix": _MATRIX,
        "fixed_frame_transforms": list_of(_FIXED_TRANSFORM),
        "link_padding": list_of(
            table({"link_name": ignored, "padding": only(0.0, hint=_USE_PADDING)})
        ),
        "link_scale": list_of(table({"link_name": ignored, "scale": only(1.0, hint=_USE_PADDING)})),
    }
)

_JOINT_CONSTRAINT: Final = table(
    {
        "joint_name": parse_name,
        "position": parse_number,
        "tolerance_above": parse_tolerance,
        "tolerance_below": parse_tolerance,
        "weight": ignored,
    }
)

_REGION: Final = table(
    {
        "primitives": list_of(parse_primitive),
        "primitive_poses": list_of(parse_pose),
        "meshes": refused("write a box, a sphere or a cylinder"),
        "mesh_poses": refused("write a box, a sphere or a cylinder"),
    }
)

_POSITION_CONSTRAINT: Final = table(
    {
        "header": _HEADER,
        "link_name": parse_name,
        "target_point_offset": refused("constrain the position of the link's origin"),
        "constraint_region": _REGION,
        "weight": ignored,
    }
)

_ORIENTATION_CONSTRAINT: Final = table(
    {
        "header": _HEADER,
        "orientation": parse_rotation,
        "link_name": parse_name,
        "absolute_x_axis_tolerance": optional(parse_number, 0.0),
        "absolute_y_axis_tolerance": optional(parse_number, 0.0),
        "absolute_z_axis_tolerance": optional(parse_number, 0.0),
        "parameterization": ignored,
        "weight": ignored,
    }
)

_NOT_OBEYED: Final = refused("remove it; plans would not obey it")

_REQUEST: Final = table(
    {
        "group_name": parse_frame,
        "start_state": table(
            _STATE_FIELDS
            | {
                "attached_collision_objects": refused(
                    "write them as attached_collision_objects of the scene's robot_state"
                ),
                "is_diff": ignored,
            }
        ),
        "goal_constraints": list_of(
            table(
                {
                    "name": ignored,
                    "joint_constraints": list_of(_JOINT_CONSTRAINT),
                    "position_constraints": list_of(_POSITION_CONSTRAINT),
                    "orientation_constraints": list_of(_ORIENTATION_CONSTRAINT),
                    "visibility_constraints": _NOT_OBEYED,
                }
            )
        ),
        "path_constraints": _NOT_OBEYED,
        "trajectory_constraints": _NOT_OBEYED,
        "reference_trajectories": _NOT_OBEYED,
        "allowed_planning_time": optional(parse_number, 0.0),
        "workspace_parameters": ignored,
        "pipeline_id": ignored,
        "planner_id": ignored,
        "num_planning_attempts": ignored,
        "max_velocity_scaling_factor": ignored,
        "max_acceleration_scaling_factor": ignored,
        "cartesian_speed_end_effector_link": ignored,
        "cartesian_speed_limited_link": ignored,
        "max_cartesian_speed": ignored,
    }
)


def read_scene_message(path: StrPath) -> dict[str, Any]:
    """Read the fields of a planning scene, or of its world alone."""
    content = read_yaml(path, SCENE_KIND)
    if isinstance(content, dict) and "collision_objects" in content:
        content = {"world": content}
    with decoding(path, SCENE_KIND):
        scene: dict[str, Any] = _SCENE(content, "")
    return scene


def read_request_message(path: StrPath) -> dict[str, Any]:
    """Read the fields of a motion plan request."""
    content = read_yaml(path, REQUEST_KIND)
    with decoding(path, REQUEST_KIND):
        request: dict[str, Any] = _REQUEST(content, "")
    return request


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
        names = ", ".join(map(repr, sorted(frames)))
        raise ContentError(
            f"has poses in the frames {names}",
            "they must be in one frame",
            "write them in the planning frame; an attached object may be in its link's frame",
        )
    return next(iter(frames), WORLD)
