"""Ledgers of the fields that readers take, and lists of the fields of each format."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from numbers import Real
from typing import Any, Final, NamedTuple

from cspace._files.access import ContentError, decoding
from cspace._files.crs import check_crs
from cspace._files.plain import read_yaml
from cspace._support.check import MAX_NUMBER, parse_finite, suggest_name
from cspace._support.kinds import suggest_call
from cspace._support.reporting import warn_user
from cspace._support.units import is_expected, warn_of_large
from cspace.errors import InputError

UNKNOWN_FIELDS: Final = "unknown fields"
"""Words in :attr:`Fields.refused` of a format whose unknown fields are refused."""


class Fields(NamedTuple):
    """Fields of a format, by what its reader does with them.

    The module of each reader has a tuple ``FIELDS`` of these, and the page on fields lists them. A
    :class:`Ledger` gives a reader only fields that are named here, in backticks.

    Attributes
    ----------
    files : str
        Suffixes or name of the format, in Markdown.
    honoured, refused, warned : str
        Names of fields, separated by semicolons. A field with any effect on positions, sizes or
        occupancy is in one of them.
    harmless : str
        Names of fields without such an effect, separated by blanks.
    """

    files: str
    honoured: str = ""
    refused: str = ""
    warned: str = ""
    harmless: str = ""

    @cache  # noqa: B019 - there is one for each format
    def list_known(self) -> frozenset[str]:
        """Return the names that a reader may take."""
        return _list_names(self.honoured + self.refused + self.warned)


def _list_names(text: str) -> frozenset[str]:
    """Return the names in backticks."""
    return frozenset(re.findall("`([^`]+)`", text))


class Ledger:
    """A mapping or message, of a file or a call, which notes the fields that are taken.

    The inner mappings of a document share its ledgers, so that one warning names all fields that
    nobody took.

    Attributes
    ----------
    fields : mapping of str to value
    where : str
        Its name for messages.
    kind : str
        Kind of element, for the warning.
    """

    def __init__(
        self,
        fields: Any,
        where: str,
        formats: Fields,
        kind: str = "",
        document: Ledger | None = None,
        file: str = "",
    ) -> None:
        """Check that it is a mapping; ``document`` is the outermost one, of a ``file``."""
        self.where = where
        self.kind = kind
        self.given = fields, file or where
        self.formats = formats
        self.document = document or self
        self.members: list[Ledger] = []
        self.noted: list[tuple[str, float, str]] = []  # places, numbers and their units
        self.taken: set[str] = set()
        self.document.members.append(self)
        found = self.list_fields(fields, formats.list_known())
        if found is None:
            rule = f"it must hold fields and values, not a {type(fields).__name__}"
            raise self.fail(f"is {fields!r:.60}", rule, self.hint)
        self.fields = found

    @staticmethod
    @contextmanager
    def reading(
        source: object, kind: str, name: str, formats: Fields
    ) -> Iterator[tuple[str, Ledger]]:
        """Yield the source and ledger of a document, then close it.

        ``name`` is that of the outermost mapping in errors. A ContentError in the block becomes a
        FileError, or an InputError for what a caller passes.
        """
        if isinstance(source, str | os.PathLike):
            file = os.fspath(source)
            content = read_yaml(source, kind)
            with decoding(source, kind):
                document = Ledger(content, name, formats, file=file)
                yield file, document
                document.close(file)
            return
        try:
            document = Ledger(source, name, formats)
            yield kind, document
            document.close(kind)
        except ContentError as error:
            problem, rule, hint = error.parts
            argument = kind
            if problem.startswith(name):
                argument, _, problem = problem.partition(" ")
            raise InputError(argument, problem, rule, hint) from error

    @staticmethod
    def list_fields(value: Any, known: Collection[str] = ()) -> Mapping[str, Any] | None:
        """Return a mapping's or message's fields, or None.

        Messages have the fields that they list, and those that are ``known``.
        """
        if isinstance(value, Mapping):
            return value
        # Arrays have data, and texts have a center, but they are no messages.
        is_geometry = hasattr(value, "__geo_interface__")  # whose z may raise an error
        if is_geometry or hasattr(value, "tolist") or type(value).__module__ == "builtins":
            return None
        # Messages list their fields in ROS 2, in rosbags and in ROS 1.
        list_names = getattr(value, "get_fields_and_field_types", tuple)
        slots = getattr(value, "__slots__", ())
        if dataclasses.is_dataclass(value):  # whose class variables are no fields
            slots = [each.name for each in dataclasses.fields(value)]
        names = [*(list_names() or slots), *known]
        return {name: getattr(value, name) for name in names if hasattr(value, name)} or None

    def fail(self, problem: str, rule: str, hint: str = "") -> ContentError:
        """Return an error that names the mapping."""
        return ContentError(f"{self.where} {problem}", rule, hint)

    def get(self, key: str, otherwise: Any = None) -> Any:
        """Take a field; one that is null is missing."""
        if key not in self.formats.list_known():
            raise KeyError(f"{key} is in no list of {self.formats.files}")
        self.taken.add(key)
        value = self.fields.get(key)
        return otherwise if value is None else value

    def need(self, key: str) -> Any:
        """Take a field that must be there."""
        value = self.get(key)
        if value is None:
            present = ", ".join(map(str, self.fields))
            others = f", besides {present:.200}" if present else "; it has no field at all"
            raise self.fail(f"has no {key}", f"it must have one{others}", self.hint)
        return value

    @property
    def hint(self) -> str:
        """The call that takes a mapping or message of another kind, or ""."""
        return suggest_call(*self.given)

    def number(
        self,
        key: str,
        otherwise: float | None = None,
        lowest: float = -MAX_NUMBER,
        highest: float = MAX_NUMBER,
    ) -> float:
        """Take a finite number between two bounds."""
        value = self.need(key) if otherwise is None else self.get(key, otherwise)
        return self.check_number(key, value, lowest, highest)

    def numbers(self, keys: Sequence[str]) -> list[float]:
        """Take several finite numbers."""
        return [self.number(key) for key in keys]

    def count(self, key: str, lowest: int = 0) -> int:
        """Take a whole number."""
        count = self.number(key, lowest=lowest)
        if count % 1.0:
            raise self.fail(f"has the {key} {count!r}", "it must be a whole number")
        return int(count)

    def flag(self, key: str) -> bool:
        """Take a truth value; a missing one is False."""
        value = self.get(key, False)
        if not isinstance(value, bool):
            rule = "it must be true or false"
            raise self.fail(f"has the {key} {value!r:.60}", rule)
        return value

    def crs(self, key: str) -> None:
        """Take a reference system; refuse one not in metres, and warn of unknown ones."""
        value = self.get(key)
        if value is not None:
            check_crs(value, key)

    def angle(self, key: str) -> float:
        """Take an angle, radians; warn beyond a whole turn."""
        return self.note_angle(key, self.number(key))

    def note_angle(self, name: str, angle: float) -> float:
        """Note an angle, radians, for the document's warning."""
        self.document.noted.append((f"{self.where}.{name}", angle, "rad"))
        return angle

    def check_number(
        self,
        name: str,
        value: Any,
        lowest: float = -MAX_NUMBER,
        highest: float = MAX_NUMBER,
    ) -> float:
        """Return a value if it is a number between two bounds."""
        return self.check_value(self.where, name, value, lowest, highest)

    @staticmethod
    def check_value(
        where: str,
        name: str,
        value: Any,
        lowest: float = -MAX_NUMBER,
        highest: float = MAX_NUMBER,
    ) -> float:
        """Return a value if it is a number between two bounds."""
        is_number = isinstance(value, int | float | Real) and not isinstance(value, bool)
        if is_number and lowest <= value <= highest:
            return float(value)
        rule = "it must be a finite number"
        if lowest > -MAX_NUMBER:
            rule += f", at least {lowest:g}"
        if highest < MAX_NUMBER:
            rule += f", at most {highest:g}"
        if isinstance(value, str) and parse_finite(value):
            rule += ", without quotes"
        # Words in place of the rest of a list or text that ``ros2 topic echo`` cuts.
        if isinstance(value, str) and value.startswith(("...", "<sequence")):
            rule += ", and the message whole"
        raise ContentError(f"{where} has the {name} {value!r:.60}", rule)

    def point(self, value: Any) -> tuple[float, float]:
        """Return the first two of a list of coordinates."""
        if not isinstance(value, list) or len(value) < 2:
            raise self.fail(f"has the coordinates {value!r:.60}", "x and y are needed")
        return self.check_number("x", value[0]), self.check_number("y", value[1])

    def entries(self, key: str) -> list[Any]:
        """Take a list; a missing one is empty."""
        value = self.get(key, [])
        if hasattr(value, "tolist"):  # an array of numpy or of Python
            value = value.tolist()
        if not isinstance(value, list | tuple):
            raise self.fail(f"has the {key} {value!r:.60}", "it must be a list")
        return list(value)

    def inner(self, fields: Any, where: str, kind: str = "") -> Ledger:
        """Return a ledger of the same document."""
        return Ledger(fields, where, self.formats, kind, self.document)

    def child(self, key: str, kind: str = "", otherwise: Any = None) -> Ledger:
        """Take the mapping or message in a field."""
        value = self.need(key) if otherwise is None else self.get(key, otherwise)
        return self.inner(value, f"{self.where}.{key}", kind or key)

    def children(self, key: str, kind: str = "", name: str = "") -> Iterator[Ledger]:
        """Take the mappings in a list, by name if they have any."""
        for number, fields in enumerate(self.entries(key)):
            child = self.inner(fields, f"{self.where}.{key}[{number}]", kind or key)
            if name:
                child.where = f"{kind} {child.need(name)!r}"
            yield child

    def refuse(
        self,
        key: str,
        *allowed: Any,
        rule: str = "it is not honoured",
        hint: str = "",
    ) -> None:
        """Refuse a field whose value is not among the allowed ones."""
        value = self.get(key)
        if value is not None and value not in allowed:
            raise self.fail(f"has {key} {value!r:.60}", rule, hint)

    def skip(self) -> None:
        """Note that the mapping concerns somebody else."""
        self.taken.update(self.fields)

    def close(self, source: str) -> None:
        """Warn once of fields that nobody took, and of numbers larger than their unit suggests.

        Raises ContentError for such fields if the format refuses them.
        """
        # Messages of rosbags say their own type.
        harmless = {"__msgtype__", *self.formats.harmless.split()}
        known = self.formats.list_known()
        # What is known but only warned of is no better name.
        read = _list_names(self.formats.honoured + self.formats.refused)
        read = read.union(*(member.taken for member in self.members))
        ignored: dict[str, str] = {}
        for member in self.members:
            for key in member.fields.keys() - member.taken - harmless:
                if member.fields[key] is None:
                    continue
                if UNKNOWN_FIELDS in self.formats.refused and key not in known:
                    problem = f"has the unknown field {str(key)!r:.60}"
                    rule = f"the fields are {', '.join(sorted(known)):.200}"
                    raise member.fail(problem, rule, suggest_name(key, known))
                name = f"{key} ({member.kind})" if member.kind else str(key)
                ignored[name] = "" if key in known else str(key)
        warn_of_names(source, ignored, read)
        for unit in dict.fromkeys(unit for *_, unit in self.noted):
            large = [each for each in self.noted if each[2] == unit and not is_expected(*each[1:])]
            for place, number, _ in large[:1]:
                warn_of_large(number, unit, f"{source}: {place}, the first of {len(large)},")


def warn_of_names(source: str, ignored: Mapping[str, str], known: Collection[str]) -> None:
    """Warn once of fields that are not read.

    ``ignored`` has the name of each field by its description, or an empty one if no other name is
    meant; ``known`` are the names that a reader would take.
    """
    if not ignored:
        return
    listed = []
    # Largest number of names that a warning lists.
    max_listed_names = 10
    for description in sorted(ignored)[:max_listed_names]:
        key = ignored[description]
        hint = suggest_name(key, known) if key and key not in known else ""
        listed.append(f"{description:.80}; {hint}" if hint else f"{description:.80}")
    if len(ignored) > max_listed_names:
        listed.append(f"{len(ignored) - max_listed_names} more")
    warn_user(f"{source}: these fields are not read: {', '.join(listed)}")
