"""Limits of joints from MoveIt's ``joint_limits.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from cspace.inside import Fields, Ledger

FIELDS: Final = (
    Fields(
        "MoveIt's `joint_limits.yaml`",
        honoured=(
            "`joint_limits`; `max_velocity`, `max_acceleration`, `max_jerk`, unless "
            "`has_velocity_limits`, `has_acceleration_limits` or `has_jerk_limits` is false"
        ),
        warned="limits of positions; default factors of scaling; unknown fields",
    ),
)


def read_joint_limits(source: object, kind: str, units: Mapping[str, str]) -> dict[str, float]:
    """Return one limit of each joint that has it; ``units`` are those of the joints.

    ``kind`` is "max_velocity", "max_acceleration" or "max_jerk".
    """
    flag = f"has_{kind.removeprefix('max_')}_limits"
    limits = {}
    with Ledger.reading(source, "joint_limits.yaml", "limits", FIELDS[0]) as (_, document):
        tables = document.child("joint_limits")
        tables.skip()
        for joint in units.keys() & tables.fields.keys():
            table = tables.inner(tables.fields[joint], f"joint {joint!r}", "joint")
            known = FIELDS[0].list_known() & table.fields.keys()
            table.taken.update(known)
            if table.get(kind) is None or table.get(flag) is False:
                continue
            limits[joint] = table.number(kind, lowest=0.0)
    return limits
