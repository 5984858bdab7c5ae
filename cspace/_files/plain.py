"""Plain values from untrusted YAML, JSON, CSV and XML files.

YAML may hold only text, numbers, booleans, null, lists, and tables with distinct keys of text.
Anchors, aliases and tags of YAML and entities of XML are refused, and nesting is bounded.
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from cspace._files.access import ContentError, decoding, read_bytes, read_text
from cspace._support.arrays import StrPath
from cspace._support.limits import SizeLimit, check_bytes, check_file_memory

MAX_LEVELS: Final = 64
"""Maximum depth of nested lists, tables and brackets."""

_PLAIN_WORD: Final = re.compile(
    r"(?P<null>(?:~|null|Null|NULL)?)"
    r"|(?P<true>true|True|TRUE|yes|Yes|YES|on|On|ON)"
    r"|(?P<false>false|False|FALSE|no|No|NO|off|Off|OFF)"
    r"|(?P<integer>[-+]?(?:0|[1-9][0-9]{0,17}))"
    r"|(?P<number>[-+]?(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)"
    r"|(?P<special>[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))"
)
"""Unquoted YAML words that are not text. As in JSON, a float needs no point."""


def read_document(path: StrPath, kind: str, limit: SizeLimit = "max_text_bytes") -> Any:
    """Read the plain value of a JSON or YAML file, or the rows of a table.

    `kind` names the expected file in messages, and `limit` is the limit of its size; YAML has a
    lower one. Suffixes of YAML are .yaml and .yml, those of JSON are .json and .geojson; all others
    are tables of texts between commas, as lists of rows.

    Raises FileError if the file is missing, is too large, or is not in its format.
    """
    suffix = Path(path).suffix.lower()
    if suffix in (".yaml", ".yml"):
        return read_yaml(path, kind)
    if suffix in (".json", ".geojson"):
        return read_json(path, kind, limit=limit)
    # Bytes of memory to load one byte of a table. Measured: 53 for lines of one digit.
    text = read_text(path, kind, 60.0, limit)
    with decoding(path, "table", f"a {kind} must be lines of texts between commas"):
        return list(csv.reader(text.splitlines()))


def read_yaml(path: StrPath, kind: str) -> Any:
    """Read the plain value of a YAML file.

    `kind` names the expected file in messages.

    Raises FileError if the file is missing, is too large, is not YAML, or holds more than one
    document or anything but plain values.
    """
    # Bytes of memory to load one byte of YAML. Measured: 57 for many tables of one short key.
    text = read_text(path, kind, 60.0, "max_description_bytes")
    with decoding(path, "YAML file", f"a {kind} must be YAML"):
        return _load_yaml(text)


@dataclass(slots=True)
class _Level:
    """An open list or table of a YAML document.

    `key` is the key of the table's next value, None if a key comes next.
    """

    values: list[Any] | dict[str, Any]
    key: str | None = None

    def add(self, value: Any, event: Any) -> None:
        """Append a value to the list, or as a key or value.

        Raises ContentError if a key is not text or is repeated.
        """
        if isinstance(self.values, list):
            self.values.append(value)
        elif self.key is not None:
            self.values[self.key] = value
            self.key = None
        elif isinstance(value, str) and value not in self.values:
            self.key = value
        else:
            name = str(value)[:40]
            raise _make_yaml_error(event, f"the key {name!r}, which is not text or is repeated,")


def _load_yaml(text: str) -> Any:
    """Load a YAML document of plain values.

    PyYAML splits the text into events. They are joined here, because its own loader recurses, and
    takes ten times as long for many short lists.

    Raises ContentError if it holds anything else.
    """
    import yaml

    # PyYAML is eight times faster if it was built with libyaml.
    loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    documents: list[Any] = []
    levels = [_Level(documents)]  # the open lists and tables, the innermost last
    for event in yaml.parse(text, Loader=loader):
        if getattr(event, "anchor", None) or getattr(event, "tag", None):
            raise _make_yaml_error(event, "an anchor, alias or tag")
        if isinstance(event, yaml.ScalarEvent):
            is_unquoted = event.implicit[0]
            value = _parse_word(event.value) if is_unquoted else event.value
            levels[-1].add(value, event)
        elif isinstance(event, yaml.CollectionStartEvent):
            if len(levels) > MAX_LEVELS:
                raise _make_yaml_error(event, f"more than {MAX_LEVELS} levels of lists and tables")
            levels.append(_Level([] if isinstance(event, yaml.SequenceStartEvent) else {}))
        elif isinstance(event, yaml.CollectionEndEvent):
            values = levels.pop().values
            levels[-1].add(values, event)
    # The output of ros2 topic echo ends with ---, and so with an empty document.
    documents = [document for document in documents if document is not None]
    if len(documents) > 1:
        problem = f"holds {len(documents)} documents, between lines of ---"
        raise ContentError(problem, "it must hold one")
    return documents[0] if documents else None


def _parse_word(word: str) -> Any:
    """Convert an unquoted YAML word to a plain value."""
    # The pattern has a group for each kind of word; the last group that matched is the kind.
    match = _PLAIN_WORD.fullmatch(word)
    kind = match.lastgroup if match else None
    if kind == "null":
        return None
    if kind in ("true", "false"):
        return kind == "true"
    if kind == "integer":
        return int(word)
    if kind == "number":
        return float(word)
    if kind == "special":
        return float(word.replace(".", ""))
    return word


def read_json(
    path: StrPath,
    kind: str,
    each_list: float = 0.0,
    limit: SizeLimit = "max_text_bytes",
) -> Any:
    """Read the value of a JSON file.

    `kind` names the expected file in messages. The caller needs `each_list` bytes for each list of
    the file, besides the value itself. `limit` is the limit of :mod:`cspace._support.limits` for
    its size.

    Raises FileError if the file is missing, is too large, is not JSON, is nested too deeply, or
    does not fit into memory.
    """
    # Bytes of memory to load one byte of JSON.
    memory_per_json_byte = 20.0
    text = read_text(path, kind, memory_per_json_byte, limit)
    with decoding(path, "JSON file", f"a {kind} must be JSON"):
        check_nesting(text, "[{", "]}")
        lists = text.count("[")
        needed = each_list * lists + memory_per_json_byte * len(text)
        check_file_memory(path, f"holds {lists:,} lists", needed)
        # int() takes quadratic time; the float of a very long integer is infinite. Eighteen digits
        # fit into 64 bits.
        decoder = json.JSONDecoder(
            parse_int=lambda word: float(word) if len(word) > 18 else int(word),
            object_pairs_hook=_join_pairs,
        )
        text = text.strip()
        value, end = decoder.raw_decode(text)
        if end < len(text):
            raise ContentError("holds more than one document", f"a {kind} must be one")
        return value


def _join_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a table of JSON; raise ContentError if a key is repeated."""
    table = dict(pairs)
    if len(table) < len(pairs):
        (name, _), *_ = Counter(key for key, _ in pairs).most_common(1)
        problem = f"has {name[:40]!r} twice in one table"
        raise ContentError(problem, "only the last would be read")
    return table


def read_xml(path: StrPath, kind: str, text: str | None = None) -> Element:
    """Read the root of an XML file, or of its text, for which the path is a name.

    `kind` names the expected file in messages.

    Raises FileError if the file is missing, is too large, or is none that :func:`parse_xml` takes.
    """
    # Bytes of memory to load one byte of XML.
    memory = 20.0
    if text is None:
        data = read_bytes(path, kind, memory, "max_description_bytes")
    else:
        data = text.strip().encode()
        check_bytes(os.fspath(path), len(data), memory=memory, limit="max_description_bytes")
    with decoding(path, kind):
        return parse_xml(data)


def parse_xml(data: bytes) -> Element:
    """Parse XML without entities.

    Entities let a small file unfold into a huge one.

    Raises ContentError if it is not XML, declares an entity, or is nested too deeply.
    """
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import ParseError, fromstring

    try:
        root: Element = fromstring(data)
    except DefusedXmlException as error:
        raise ContentError("declares an XML entity, which is refused") from error
    except ParseError as error:
        raise ContentError(f"is not XML ({error})") from error
    # Level by level, because a recursion could exceed Python's limit.
    elements = [root]
    level = 0
    # Maximum depth of nested XML elements.
    max_xml_levels = 256
    while elements:
        level += 1
        if level > max_xml_levels:
            raise ContentError(f"has more than {max_xml_levels} nested elements")
        elements = [child for element in elements for child in element]
    return root


def check_nesting(text: str, opening: str, closing: str) -> None:
    """Limit the nesting of brackets before a parser recurses into them.

    Raises ContentError if there are more than 64 levels.
    """
    level_change = np.zeros(256, dtype=np.int32)  # by character
    level_change[list(map(ord, opening))] = 1
    level_change[list(map(ord, closing))] = -1
    # The level at each character is the sum of the changes before it.
    level = 0
    # Number of characters whose brackets are counted at once.
    characters_per_block = 2**22
    for start in range(0, len(text), characters_per_block):
        block = text[start : start + characters_per_block].encode("latin-1", "replace")
        characters = np.frombuffer(block, dtype=np.uint8)
        levels = level + np.cumsum(level_change[characters])
        level = int(levels[-1])
        if levels.max() > MAX_LEVELS:
            raise ContentError(f"has more than {MAX_LEVELS} nested brackets")


def _make_yaml_error(event: Any, what: str) -> ContentError:
    """Return the error for YAML that is not a plain value."""
    problem = f"has {what} in line {event.start_mark.line + 1}"
    rule = "only text, numbers, lists and tables are read"
    return ContentError(problem, rule)
