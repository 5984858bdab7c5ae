"""What a page asks of a package that plans, and of what it finds; :mod:`planners` is that package."""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any, Final, Protocol, cast

from cspace.arrays import Floats

PACKAGE: Final = "planners"
"""It builds on this package, which asks for it by name, as for other optional ones."""


class TimesLike(Protocol):
    """How long the steps of a plan took, in seconds."""

    @property
    def planning(self) -> float: ...
    @property
    def simplification(self) -> float: ...


class PlanLike(Protocol):
    """What a search on a page found; :class:`planners.Plan` has it all, and describes it."""

    @property
    def path(self) -> Floats: ...
    @property
    def waypoints(self) -> Floats: ...
    @property
    def axes(self) -> tuple[str, ...]: ...
    @property
    def units(self) -> tuple[str, ...]: ...
    @property
    def length_unit(self) -> str: ...
    @property
    def solved(self) -> bool: ...
    @property
    def certified(self) -> bool: ...
    @property
    def status(self) -> str: ...
    @property
    def advice(self) -> str: ...
    @property
    def length(self) -> float: ...
    @property
    def turning(self) -> float: ...
    @property
    def clearance(self) -> float: ...
    @property
    def distance_text(self) -> str: ...
    @property
    def path_exists(self) -> bool | None: ...
    @property
    def planner(self) -> str: ...
    @property
    def drive(self) -> str: ...
    @property
    def turning_radius(self) -> float | None: ...
    @property
    def times(self) -> TimesLike: ...
    def to_csv(self, path: str | os.PathLike[str], overwrite: bool = False) -> None: ...
    def to_json(self, path: str | os.PathLike[str], overwrite: bool = False) -> None: ...


class ChoicesLike(Protocol):
    """What a planner can be given on a space; as :class:`planners.Choices`."""

    @property
    def planners(self) -> tuple[str, ...]: ...
    @property
    def drives(self) -> tuple[str, ...]: ...
    @property
    def curves(self) -> tuple[str, ...]: ...


class Planning(Protocol):
    """A package that plans."""

    def choices(self, space: Any, /) -> ChoicesLike: ...

    def plan(
        self,
        space: Any,
        start: Floats,
        goal: Floats,
        /,
        *,
        planner: str | None,
        time_limit: float,
        exact: bool,
        drive: str,
        turning_radius: float | None,
    ) -> PlanLike: ...


def planning() -> Planning:
    """The package that plans.

    Raises MissingPackageError if it cannot: OMPL is not installed.
    """
    return cast(Planning, import_module(PACKAGE))
