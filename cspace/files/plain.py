"""YAML, JSON and XML files from strangers, as plain values.

Of YAML, only text, numbers, booleans, null, lists and tables with distinct keys of text are read. Anchors, aliases and
tags of YAML and entities of XML are refused, and nesting is bounded. A problem becomes one error that names the file.
"""

from __future__ import annotations

import json
import os
import re
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from cspace.files.access import Fault, decoding, read_text
from cspace.limits import check_file_memory

_MAX_LEVELS: Final = 64
"""Maximum depth of nested lists, tables and brackets."""

_MAX_XML_LEVELS: Final = 256
"""Maximum depth of nested XML elements."""

_BLOCK: Final = 2**22
"""Characters whose brackets are counted at once."""

_SCALARS: Final = {
    "null": ("~nN", r"~|null|Null|NULL|"),
    "bool": ("tTfFyYoOnN", r"true|True|TRUE|yes|Yes|YES|on|On|ON|false|False|FALSE|no|No|NO|off|Off|OFF"),
    "int": ("-+0123456789", r"[-+]?(0|[1-9]\d{0,17})"),
    "float": (
        "-+.0123456789",
        r"[-+]?((0|[1-9]\d*)(\.\d*)?|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
    ),
}
"""First letters and form of unquoted YAML words that are not text. As in JSON, a float needs no point."""

_YAML_MEMORY: Final = 200.0
"""Bytes of memory to load one byte of YAML. Measured: 187 for a list of one-digit numbers."""


def read_yaml(path: str | os.PathLike[str], kind: str) -> Any:
    """Read the plain value of a YAML file; ``kind`` says in messages what it should be.

    Raises FileError if the file is missing, is not YAML, or holds more than one document or anything but plain values.
    """
    text = read_text(path, kind, memory=_YAML_MEMORY)
    with decoding(path, "YAML file", f"a {kind} is one", "mend that line"):
        return _load_yaml(text)


def _load_yaml(text: str) -> Any:
    """Load a YAML document with PyYAML; raise Fault if it holds more than plain values."""
    import yaml

    # Where PyYAML is built with libyaml, that is eight times faster.
    safe: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

    class Loader(safe):  # type: ignore[misc]
        yaml_implicit_resolvers: dict[str | None, list[Any]] = {}  # noqa: RUF012 - those below, not those of YAML 1.1

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            seen = set()
            for key, _ in node.value:
                if key.tag != "tag:yaml.org,2002:str" or key.value in seen:
                    raise _not_plain(key, f"the key {str(key.value)[:40]!r}, which is no text, or there twice,")
                seen.add(key.value)
            return super().construct_mapping(node, deep)

    for name, (first, form) in _SCALARS.items():
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{name}", re.compile(rf"({form})\Z"), ["", *first])
    # These checks come first because the loader recurses into lists and tables.
    level = documents = 0
    for event in yaml.parse(text, Loader=safe):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) or _has_tag(event):
            raise _not_plain(event, "an anchor, alias or tag")
        level += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        documents += isinstance(event, yaml.DocumentStartEvent)
        if level > _MAX_LEVELS:
            raise _not_plain(event, f"more than {_MAX_LEVELS} levels of lists and tables")
    if documents > 1:
        raise Fault(f"holds {documents} documents", "it must hold one", "remove the others")
    return yaml.load(text, Loader=Loader)


def _has_tag(event: Any) -> bool:
    return getattr(event, "tag", None) not in (None, "!")


def read_json(path: str | os.PathLike[str], kind: str, each_list: float = 0.0) -> Any:
    """The value of a JSON file; ``kind`` says in messages what it should be.

    ``each_list`` bytes are what the caller takes for each list of the file, beside what the value itself takes. Raises
    FileError if the file is missing, is not JSON, is nested too deeply, or does not fit into memory.
    """
    text = read_text(path, kind, memory=20.0)
    with decoding(path, "JSON file", f"a {kind} is one", "mend that place"):
        check_nesting(text, "[{", "]}")
        lists = text.count("[")
        check_file_memory(path, f"holds {lists:,} lists", each_list * lists + 20.0 * len(text))
        return json.loads(text, parse_int=_integer)


def parse_xml(data: bytes) -> Element:
    """Parse XML without entities, by which a small file unfolds into a huge one.

    Raises Fault if it is not XML, declares an entity, or is nested too deeply.
    """
    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import ParseError, fromstring

    try:
        root: Element = fromstring(data)
    except DefusedXmlException as error:
        raise Fault("declares an entity of XML, which is not read") from error
    except ParseError as error:
        raise Fault(f"is no XML ({error})") from error
    elements, level = [root], 0
    while elements:
        level += 1
        if level > _MAX_XML_LEVELS:
            raise Fault(f"has more than {_MAX_XML_LEVELS} elements within each other")
        elements = [child for element in elements for child in element]
    return root


def check_nesting(text: str, opening: str, closing: str) -> None:
    """Refuse brackets within brackets before anything recurses into them.

    Raises Fault if there are more than 64 levels.
    """
    steps = np.zeros(256, dtype=np.int32)
    steps[[ord(letter) for letter in opening]] = 1
    steps[[ord(letter) for letter in closing]] = -1
    level = 0
    for start in range(0, len(text), _BLOCK):
        letters = np.frombuffer(text[start : start + _BLOCK].encode("latin-1", "replace"), dtype=np.uint8)
        levels = level + np.cumsum(steps[letters])
        level = int(levels[-1])
        if levels.max() > _MAX_LEVELS:
            raise Fault(
                f"has more than {_MAX_LEVELS} brackets within each other", "it is malformed", "write it flatter"
            )


def _integer(word: str) -> int | float:
    """A whole number of JSON; as a float where it is beyond 64 bits, and infinite beyond those."""
    return int(word) if len(word) < 19 else float(word)


def _not_plain(event: Any, what: str) -> Fault:
    problem, rule = f"has {what} in line {event.start_mark.line + 1}", "plain text, numbers, lists and tables are read"
    return Fault(problem, rule, "mend that line")


_XACRO: Final = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}")
"""What the names of xacro's elements begin with. Files that it has expanded may still declare that they have some."""


def check_expanded(root: Element) -> None:
    """Refuse a file with macros of xacro."""
    if any(str(element.tag).startswith(_XACRO) for element in root.iter()):
        raise Fault("holds macros of xacro", "they are expanded first", "run xacro robot.urdf.xacro > robot.urdf")
