"""YAML and JSON as plain values: text, numbers, true and false, lists, and tables with text for keys; and XML.

Nothing else of YAML is read: no tags, which make objects, no anchors, by which a small file unfolds into a huge one. No
more are entities of XML, which do so too. Whatever is wrong becomes one error that names the file.
"""

from __future__ import annotations

import json
import os
import re
from typing import Any, Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError, ParserCreate

import numpy as np

from cspace.files.access import Fault, decoding, read_text
from cspace.files.limits import check_memory

DEEPEST: Final = 64
"""Levels of lists, tables and brackets, at most."""

_ELEMENTS: Final = 256
"""Levels of elements of XML, at most."""

_BLOCK: Final = 2**22
"""Characters whose brackets are counted at once."""

_CONSTANTS: Final[dict[str, bool | None]] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **{form: True for word in ("true", "yes", "on") for form in (word, word.capitalize(), word.upper())},
    **{form: False for word in ("false", "no", "off") for form in (word, word.capitalize(), word.upper())},
}
"""Words of YAML 1.1 that are no text."""

_INTEGER: Final = re.compile(r"[-+]?(0|[1-9]\d{0,17})")
_FLOAT: Final = re.compile(r"[-+]?(0|[1-9]\d*|(?=\.\d))(\.\d*)?([eE][-+]?\d+)?")
_SPECIAL: Final = {"inf": np.inf, "+inf": np.inf, "-inf": -np.inf, "nan": np.nan}


def read_yaml(path: str | os.PathLike[str], kind: str) -> Any:
    """The plain value of a YAML file; ``kind`` says in messages what it should be.

    Raises FileError if the file is missing, is not YAML, or holds more than one document or anything but plain values.
    """
    import yaml

    text, loader = read_text(path, kind, memory=40.0), getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    # Lists and tables that are open, each with the key that waits for its value; the first holds the document.
    open_values: list[Any] = [[]]
    keys: list[Any] = [None]
    with decoding(path, "YAML file", f"a {kind} is one", "mend that line"):
        for event in yaml.parse(text, Loader=loader):
            if isinstance(event, yaml.NodeEvent):
                if isinstance(event, yaml.AliasEvent) or event.anchor or getattr(event, "tag", None) not in (None, "!"):
                    raise _not_plain(event, "an anchor, alias or tag")
                if isinstance(event, yaml.ScalarEvent):
                    _put(open_values[-1], keys, _scalar(event), event)
                else:
                    if len(open_values) > DEEPEST:
                        raise _not_plain(event, f"more than {DEEPEST} levels of lists and tables")
                    value: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
                    _put(open_values[-1], keys, value, event)
                    open_values.append(value)
                    keys.append(None)
            elif isinstance(event, yaml.CollectionEndEvent):
                open_values.pop()
                keys.pop()
        if len(open_values[0]) > 1:
            raise Fault(f"holds {len(open_values[0])} documents", "it must hold one", "remove the others")
    return open_values[0][0] if open_values[0] else None


def read_json(path: str | os.PathLike[str], kind: str, each_list: float = 0.0) -> Any:
    """The value of a JSON file; ``kind`` says in messages what it should be.

    ``each_list`` bytes are what the caller takes for each list of the file, beside what the value itself takes. Raises
    FileError if the file is missing, is not JSON, is nested too deeply, or does not fit into memory.
    """
    text = read_text(path, kind, memory=20.0)
    with decoding(path, "JSON file", f"a {kind} is one", "mend that place"):
        check_nesting(text, "[{", "]}")
        lists = text.count("[")
        check_memory(path, f"holds {lists:,} lists", each_list * lists + 20.0 * len(text))
        return json.loads(text, parse_int=_integer)


def parse_xml(data: bytes) -> Element:
    """The tree of a text without entities, by which a small file unfolds into a huge one, nested in bounds.

    Raises Fault if it is no XML, or more than that.
    """
    depth = 0

    def opened(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _ELEMENTS:
            raise Fault(f"has more than {_ELEMENTS} elements within each other")

    def closed(name: str) -> None:
        nonlocal depth
        depth -= 1

    def entity(*about: object) -> None:
        raise Fault("declares an entity of XML, which is not read")

    scan = ParserCreate()
    scan.StartElementHandler, scan.EndElementHandler, scan.EntityDeclHandler = opened, closed, entity
    try:
        scan.Parse(data, True)
        return ElementTree.fromstring(data)
    except (ElementTree.ParseError, ExpatError) as error:
        raise Fault(f"is no XML ({error})") from error


def check_nesting(text: str, opening: str, closing: str) -> None:
    """Refuse brackets within brackets before anything recurses into them.

    Raises Fault if there are more than :data:`DEEPEST` levels.
    """
    steps = np.zeros(256, dtype=np.int32)
    steps[[ord(letter) for letter in opening]] = 1
    steps[[ord(letter) for letter in closing]] = -1
    level = 0
    for start in range(0, len(text), _BLOCK):
        letters = np.frombuffer(text[start : start + _BLOCK].encode("latin-1", "replace"), dtype=np.uint8)
        levels = level + np.cumsum(steps[letters])
        level = int(levels[-1])
        if levels.max() > DEEPEST:
            raise Fault(f"has more than {DEEPEST} brackets within each other", "it is malformed", "write it flatter")


def _put(place: Any, keys: list[Any], value: Any, event: Any) -> None:
    """Add a value to the list or table that is open, or keep it as the key of the next one."""
    if isinstance(place, list):
        place.append(value)
    elif keys[-1] is not None:
        place[keys[-1]] = value
        keys[-1] = None
    elif not isinstance(value, str) or value in place:
        raise _not_plain(event, f"the key {str(value)[:40]!r}, which is no text, or there twice,")
    else:
        keys[-1] = value


def _scalar(event: Any) -> Any:
    """The value of one word: quoted ones are text."""
    word: str = event.value
    if event.style in ("'", '"', "|", ">"):
        return word
    if word in _CONSTANTS:
        return _CONSTANTS[word]
    if _INTEGER.fullmatch(word):
        return int(word)
    if word and _FLOAT.fullmatch(word):
        return float(word)
    head, _, name = word.lower().partition(".")
    return _SPECIAL.get(head + name, word) if head in ("", "+", "-") else word


def _integer(word: str) -> int | float:
    """A whole number of JSON; as a float where it is beyond 64 bits, and infinite beyond those."""
    return int(word) if len(word) < 19 else float(word)


def _not_plain(event: Any, what: str) -> Fault:
    fault, rule = f"has {what} in line {event.start_mark.line + 1}", "plain text, numbers, lists and tables are read"
    return Fault(fault, rule, "mend that line")


_XACRO: Final = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}")
"""What the names of xacro's elements begin with. Files that it has expanded may still declare that they have some."""


def check_expanded(root: Element) -> None:
    """Refuse a file with macros of xacro."""
    if any(str(element.tag).startswith(_XACRO) for element in root.iter()):
        raise Fault("holds macros of xacro", "they are expanded first", "run xacro robot.urdf.xacro > robot.urdf")
