"""Kinds of spaces, with the places and options of their plans."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeGuard

from cspace import CSpace, Space
from cspace.errors import InputError
from cspace.inside import ConfigurationMap, ConfigurationSpace

MAPS: Final = "maps of poses"
TILED_MAPS: Final = "tiled maps"
JOINT_MAPS: Final = "maps of joints"
ARMS: Final = "arms"
OWN_SPACES: Final = "your own spaces"
SPACE_KINDS: Final = (MAPS, TILED_MAPS, JOINT_MAPS, ARMS, OWN_SPACES)
"""Kinds of spaces."""

ANY_ROTATION: Final = "a place with any rotation"
REGION: Final = "a place that is a region"
NEAR: Final = "`planners.Near`"
NEAR_START: Final = "`planners.Near` as the start"
"""Places in :data:`SUPPORTED`."""

SUPPORTED: Final[Mapping[str, tuple[str, ...]]] = {
    "a list of alternatives": SPACE_KINDS,
    "`cspace.PoseGoal`": (ARMS,),
    ANY_ROTATION: (MAPS, TILED_MAPS),
    REGION: (MAPS, TILED_MAPS),
    NEAR: (MAPS, TILED_MAPS),
    NEAR_START: (MAPS, TILED_MAPS, JOINT_MAPS),
    "`via`": SPACE_KINDS,
    "`keep`": (ARMS,),
}
"""Kinds of spaces that each goal and option is for; the page on planning prints this table."""


def find_space_kind(space: Space) -> str:
    """Return the kind of a space, out of :data:`SPACE_KINDS`."""
    if not isinstance(space, ConfigurationMap):
        return ARMS if isinstance(space, ConfigurationSpace) else OWN_SPACES
    if not isinstance(space, CSpace):
        return TILED_MAPS
    return MAPS if space.has_poses else JOINT_MAPS


def is_tiled(space: Space) -> bool:
    """Return True for maps in tiles."""
    return find_space_kind(space) == TILED_MAPS


def has_positions(space: Space) -> TypeGuard[ConfigurationMap]:
    """Return True for maps of poses, in memory or in tiles."""
    return find_space_kind(space) in (MAPS, TILED_MAPS)


def check_support(option: str, argument: str, value: object, space: Space) -> None:
    """Raise InputError for a goal or option outside :data:`SUPPORTED`."""
    kinds = SUPPORTED[option]
    if find_space_kind(space) not in kinds:
        problem = f"is {value!r} and space is {space!r}"
        raise InputError(argument, problem, f"it is for {' and '.join(kinds)}")
    if option == REGION and space.dim != 2:
        raise InputError(argument, f"is {value!r}", "a region is for maps of the plane")
    if option == ANY_ROTATION and not space.rotations.names:
        problem = f"is {value!r} and the axes are ({', '.join(space.axes)})"
        raise InputError(argument, problem, "the robot does not turn")
