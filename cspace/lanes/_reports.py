"""Tables and files of reports."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from cspace.inside import StrPath, replacing

MAX_PRINTED_ROWS: Final = 40
"""Number of rows that a printed table lists."""


class JunitCase(NamedTuple):
    """A test of a JUnit report.

    Attributes
    ----------
    name : str
    message : str
        Problem, or empty if the test passes.
    fails : bool
        Whether the problem is a failure; otherwise the test is skipped.
    """

    name: str
    message: str = ""
    fails: bool = False


def format_value(value: Any) -> str:
    """Format a value for a table."""
    if isinstance(value, tuple):
        return f"({', '.join(map(format_value, value))})"
    if isinstance(value, float):
        return f"{value:.3f}"
    return "" if value is None else str(value)


def format_table(columns: Sequence[str], rows: Sequence[Iterable[Any]], noun: str) -> list[str]:
    """Return a table's lines, without empty columns, and count omitted rows as ``noun``."""
    cells = [tuple(map(format_value, row)) for row in rows[:MAX_PRINTED_ROWS]]
    filled = [k for k in range(len(columns)) if not cells or any(row[k] for row in cells)]
    table = [tuple(row[k] for k in filled) for row in (tuple(columns), *cells)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ["  ".join(map(str.ljust, row, widths)).rstrip() for row in table]
    if len(rows) > MAX_PRINTED_ROWS:
        lines.append(f"... and {len(rows) - MAX_PRINTED_ROWS} more {noun}")
    return lines


def write_csv(
    path: StrPath, overwrite: bool, columns: Sequence[str], rows: Iterable[Mapping[str, Any]]
) -> None:
    """Write rows by column names; spaces separate numbers of tuples."""
    with replacing(path, overwrite) as file, file.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _join(value) for name, value in row.items()})


def _join(value: Any) -> Any:
    """Join the numbers of a tuple."""
    return " ".join(map(repr, value)) if isinstance(value, tuple) else value


def write_json(path: StrPath, overwrite: bool, document: Mapping[str, Any]) -> None:
    """Write a document as JSON."""
    with replacing(path, overwrite) as file:
        file.write_text(json.dumps(document, allow_nan=False))


def make_features(
    shapes: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]],
    path: StrPath | None,
    overwrite: bool,
) -> dict[str, Any]:
    """Return geometries with their properties as GeoJSON, and write it to a path."""
    features = [
        {"type": "Feature", "geometry": geometry, "properties": properties}
        for geometry, properties in shapes
    ]
    document = {"type": "FeatureCollection", "features": features}
    if path is not None:
        write_json(path, overwrite, document)
    return document


def write_junit(
    path: StrPath, overwrite: bool, name: str, kind: str, cases: Sequence[JunitCase]
) -> None:
    """Write a JUnit report of tests of a kind."""
    failures = sum(case.fails for case in cases)
    suite = ElementTree.Element(
        "testsuite",
        name=_as_xml(name),
        tests=str(len(cases)),
        failures=str(failures),
        errors="0",
        skipped=str(sum(bool(case.message) for case in cases) - failures),
    )
    for case in cases:
        name = _as_xml(case.name)
        element = ElementTree.SubElement(suite, "testcase", classname=kind, name=name)
        if case.message:
            tag = "failure" if case.fails else "skipped"
            ElementTree.SubElement(element, tag, message=_as_xml(case.message))
    with replacing(path, overwrite) as file:
        ElementTree.ElementTree(suite).write(file, encoding="utf-8", xml_declaration=True)


def _as_xml(text: str) -> str:
    """Replace characters that XML does not allow."""
    return "".join(letter if letter.isprintable() else "?" for letter in text)
