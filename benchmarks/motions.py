"""What several benchmarks ask of OMPL: its discrete motion validator at half a cell, states of a map, many calls."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from cspace import CSpace
from cspace.arrays import Floats


def discrete(space: CSpace, checker: Callable[[Any], Any]) -> Any:
    """OMPL's space information with a checker and its own ways otherwise: discrete motions, here at half a cell."""
    from ompl import base as ob

    import planners

    si = ob.SpaceInformation(planners.state_space(space))
    si.setStateValidityChecker(checker(si))
    at_half_a_cell(space, si)
    si.setup()
    return si


def at_half_a_cell(space: CSpace, si: Any) -> None:
    """Of turns: OMPL counts a radian as half a metre, which is more than a corner of the robots here moves."""
    si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / si.getStateSpace().getMaximumExtent())


def states_of(space: CSpace, si: Any, q: Iterable[Floats]) -> list[Any]:
    """OMPL's states of configurations."""
    from planners.states import kind_of

    kind, states = kind_of(space), []
    for numbers in space.rotations.canonical(np.asarray(q)).tolist():
        states.append(si.getStateSpace().allocState())
        kind.write(states[-1], *numbers)
    return states


def edges_of(space: CSpace, si: Any, starts: Floats, goals: Floats) -> list[tuple[Any, Any]]:
    """OMPL's states of the ends of edges."""
    return list(zip(states_of(space, si, starts), states_of(space, si, goals), strict=True))


def asker(call: Callable[..., bool], asked: list[Any]) -> Callable[[], list[bool]]:
    """Asks about states, or about edges, and does little else."""
    if isinstance(asked[0], tuple):
        return lambda: [call(first, last) for first, last in asked]
    return lambda: [call(state) for state in asked]
