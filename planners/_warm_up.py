"""Compilation ahead of the first plan."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from cspace import CSpace, Robot, Rotations, Space, Workspace, build
from cspace.inside import ConfigurationSpace, Drive
from planners._edges.drives import local_planner
from planners._plan import plan
from planners._space_kinds import has_positions

if TYPE_CHECKING:
    from cspace.arms import ArmSpace

_SAMPLED_PAIRS = 10
"""Number of pairs of an arm's configurations to plan between; some need a search."""


def warm_up(space: Space, drive: Drive | None = None) -> None:
    """Compile the code of plans on a space beforehand.

    For a map, it plans, updates and plans again on a small map with the same axes, and explains why
    no path is left; for an arm, it plans between some of its configurations. It takes up to half a
    minute on a new machine, and some tenths of a second with code cached on disk.

    Parameters
    ----------
    space : Space
    drive : Car or Differential, optional
        As for :func:`plan`.

    Raises
    ------
    InputError
        If ``space`` is no space, or ``drive`` is no drive or not for its axes.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> planners.warm_up(cspace.build(workspace, cspace.Robot.disc(0.2)))
    """
    edges = local_planner(space, drive)  # refuses other drives
    if not has_positions(space):
        if isinstance(space, ConfigurationSpace):
            sampled = cast("CSpace | ArmSpace", space)  # all other maps are of poses
            samples = sampled.sample_free(2 * _SAMPLED_PAIRS, np.random.default_rng(0))
            for start, goal in samples.reshape(_SAMPLED_PAIRS, 2, -1):
                plan(space, start, goal, time_limit=0.5, drive=drive)
        return
    small = _build_small_map(space)
    drive = edges.sample_drive
    zeros = (0.0,) * (space.size - space.dim)
    if len(zeros) == 4:
        zeros = (0.0, 0.0, 0.0, 1.0)
    height = (1.0,) * (space.dim - 2)
    start, goal = (1.0, 1.0, *height, *zeros), (1.0, 5.0, *height, *zeros)
    first = plan(small, start, goal, drive=drive)
    small.update(np.ones((2,) * space.dim, dtype=bool), (45, 30, *[5] * (space.dim - 2)))
    first.recheck()
    small.path_exists(start, goal)  # a plan calls it if it finds no path
    plan(small, start, goal, drive=drive, previous=first)
    if space.dim == 2:
        small.update(np.ones((20, 2), dtype=bool), (40, 29))  # nothing passes the wall
        str(plan(small, start, goal, drive=drive))


def _build_small_map(space: Space) -> CSpace:
    """Build a small map with a space's axes.

    It has 6 m by 6 m.
    """
    cells = np.zeros((60, 60, 20)[: space.dim], dtype=bool)
    cells[:40, 29:31] = True
    robot = Robot.rectangle(0.4, 0.2) if space.dim == 2 else Robot.box((0.4, 0.2, 0.2))
    rotations = {0: None, 1: 8, 4: Rotations.quaternions(1)}[len(space.rotations.names)]
    return build(Workspace.from_array(cells, 0.1), robot, rotations=rotations)
