"""Limits of joints from MoveIt's ``joint_limits.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from cspace.inside import Fields, Ledger, warn_user

FIELDS: Final = (
    Fields(
        "MoveIt's `joint_limits.yaml`",
        honoured=(
            "`joint_limits`; `max_velocity`, `max_acceleration`, `max_jerk`, unless "
            "`has_velocity_limits`, `has_acceleration_limits` or `has_jerk_limits` is false"
        ),
        refused="joints that the path lacks, if the file lacks one of the path; unknown fields",
        warned=(
            "other joints that the path lacks; `min_position`, `max_position`, "
            "`soft_lower_limit`, `soft_upper_limit`, "
            "`default_velocity_scaling_factor`, `default_acceleration_scaling_factor`"
        ),
        harmless=(
            "has_position_limits angle_wraparound has_effort_limits max_effort has_soft_limits "
            "k_position k_velocity has_deceleration_limits max_deceleration"
        ),
    ),
)

_HONOURED: Final = FIELDS[0]._replace(refused="", warned="").list_known()


def read_joint_limits(source: object, kind: str, units: Mapping[str, str]) -> dict[str, float]:
    """Read one kind of limit, for each joint that has it.

    ``source`` may be the table ``joint_limits`` alone. ``kind`` is "max_velocity",
    "max_acceleration" or "max_jerk". ``units`` are the joints' units.
    """
    if isinstance(source, Mapping) and "joint_limits" not in source:
        source = {"joint_limits": source}
    flag = f"has_{kind.removeprefix('max_')}_limits"
    limits = {}
    with Ledger.reading(source, "joint_limits.yaml", "limits", FIELDS[0]) as (name, document):
        tables = document.child("joint_limits")
        tables.skip()
        missing = ", ".join(joint for joint in units if joint not in tables.fields)
        others = ", ".join(str(joint) for joint in tables.fields if joint not in units)
        if missing and others:
            problem = f"names {others:.200}, and not {missing}"
            raise tables.fail(problem, f"the joints are {', '.join(units)}")
        for joint in units.keys() & tables.fields.keys():
            table = tables.inner(tables.fields[joint], f"joint {joint!r}", "joint")
            table.taken.update(_HONOURED)  # limits of other kinds are for other arguments
            has_limit = table.get(kind) is not None
            if table.get(flag) is not None:
                has_limit = table.flag(flag)
            if not has_limit:
                continue
            limits[joint] = table.number(kind, lowest=0.0)
    if others:
        warn_user(f"{name}: limits of {others:.200} are not read; the path has no such joint")
    return limits
