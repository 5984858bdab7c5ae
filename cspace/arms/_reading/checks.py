"""Checks of the names and numbers that calls and files of arms give."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from typing import Any

from cspace.errors import InputError
from cspace.inside import ContentError, check_known


def check_distinct(
    names: Iterable[str],
    place: str = "",
    rule: str = "names must differ",
) -> None:
    """Raise ContentError if two names are equal."""
    for name, times in Counter(names).items():
        if times > 1:
            raise ContentError(f"has {name[:40]!r} twice{place}", rule)


def check_mapping(values: Any, name: str, known: Collection[str]) -> dict[str, Any]:
    """Return a mapping, or a Series, of known names as dictionary.

    Raises InputError, with the most similar name, if a name is unknown.
    """
    if not (isinstance(values, Mapping) or hasattr(values, "to_dict")):
        raise InputError(name, f"is {values!r}", "it must map names to numbers")
    return {check_known(key, name, known, "names"): value for key, value in values.items()}
