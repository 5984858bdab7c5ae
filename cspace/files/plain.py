"""Plain values from untrusted YAML, JSON and XML files.

YAML may hold only text, numbers, booleans, null, lists, and tables with distinct keys of text. Anchors, aliases and
tags of YAML and entities of XML are refused, and nesting is bounded.
"""

from __future__ import annotations

import json
import os
import re
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from cspace.files.access import ContentError, decoding, read_text
from cspace.limits import check_file_memory

_MAX_LEVELS: Final = 64
"""Maximum depth of nested lists, tables and brackets."""

_MAX_XML_LEVELS: Final = 256
"""Maximum depth of nested XML elements."""

_CHARACTERS_PER_BLOCK: Final = 2**22
"""Number of characters whose brackets are counted at once."""

_SCALARS: Final = {
    "null": ("~nN", r"~|null|Null|NULL|"),
    "bool": ("tTfFyYoOnN", r"true|True|TRUE|yes|Yes|YES|on|On|ON|false|False|FALSE|no|No|NO|off|Off|OFF"),
    "int": ("-+0123456789", r"[-+]?(0|[1-9]\d{0,17})"),
    "float": (
        "-+.0123456789",
        r"[-+]?((0|[1-9]\d*)(\.\d*)?|\.\d+)([eE][-+]?\d+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
    ),
}
"""First letters and pattern of unquoted YAML words that are not text. As in JSON, a float needs no point."""

_MEMORY_PER_YAML_BYTE: Final = 200.0
"""Bytes of memory to load one byte of YAML. Measured: 187 for a list of one-digit numbers."""


def read_yaml(path: str | os.PathLike[str], kind: str) -> Any:
    """Read the plain value of a YAML file.

    `kind` names the expected file in messages.

    Raises FileError if the file is missing, is not YAML, or holds more than one document or anything but plain values.
    """
    text = read_text(path, kind, memory=_MEMORY_PER_YAML_BYTE)
    with decoding(path, "YAML file", f"a {kind} must be YAML", "correct that line"):
        return _load_yaml(text)


def _load_yaml(text: str) -> Any:
    """Load a YAML document of plain values with PyYAML.

    Raises ContentError if it holds anything else.
    """
    import yaml

    # PyYAML is eight times faster if it was built with libyaml.
    safe: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

    class Loader(safe):  # type: ignore[misc]
        yaml_implicit_resolvers: dict[str | None, list[Any]] = {}  # noqa: RUF012 - ours replace those of YAML 1.1

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            seen = set()
            for key, _ in node.value:
                if key.tag != "tag:yaml.org,2002:str" or key.value in seen:
                    raise _not_plain(key, f"the key {str(key.value)[:40]!r}, which is not text or is repeated,")
                seen.add(key.value)
            return super().construct_mapping(node, deep)

    for name, (first, form) in _SCALARS.items():
        Loader.add_implicit_resolver(f"tag:yaml.org,2002:{name}", re.compile(rf"({form})\Z"), ["", *first])
    # Check before loading, because the loader recurses into lists and tables.
    level = documents = 0
    for event in yaml.parse(text, Loader=safe):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) or _has_tag(event):
            raise _not_plain(event, "an anchor, alias or tag")
        level += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        documents += isinstance(event, yaml.DocumentStartEvent)
        if level > _MAX_LEVELS:
            raise _not_plain(event, f"more than {_MAX_LEVELS} levels of lists and tables")
    if documents > 1:
        raise ContentError(f"holds {documents} documents", "it must hold one", "remove the others")
    return yaml.load(text, Loader=Loader)


def _has_tag(event: Any) -> bool:
    return getattr(event, "tag", None) not in (None, "!")


def read_json(path: str | os.PathLike[str], kind: str, each_list: float = 0.0) -> Any:
    """Read the value of a JSON file.

    `kind` names the expected file in messages. The caller needs `each_list` bytes for each list of the file,
    besides the value itself.

    Raises FileError if the file is missing, is not JSON, is nested too deeply, or does not fit into memory.
    """
    text = read_text(path, kind, memory=20.0)
    with decoding(path, "JSON file", f"a {kind} must be JSON", "correct that place"):
        check_nesting(text, "[{", "]}")
        lists = text.count("[")
        check_file_memory(path, f"holds {lists:,} lists", each_list * lists + 20.0 * len(text))
        return json.loads(text, parse_int=_integer)


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
    elements, level = [root], 0
    while elements:
        level += 1
        if level > _MAX_XML_LEVELS:
            raise ContentError(f"has more than {_MAX_XML_LEVELS} nested elements")
        elements = [child for element in elements for child in element]
    return root


def check_nesting(text: str, opening: str, closing: str) -> None:
    """Limit the nesting of brackets before a parser recurses into them.

    Raises ContentError if there are more than 64 levels.
    """
    steps = np.zeros(256, dtype=np.int32)
    steps[[ord(letter) for letter in opening]] = 1
    steps[[ord(letter) for letter in closing]] = -1
    level = 0
    for start in range(0, len(text), _CHARACTERS_PER_BLOCK):
        letters = np.frombuffer(
            text[start : start + _CHARACTERS_PER_BLOCK].encode("latin-1", "replace"), dtype=np.uint8
        )
        levels = level + np.cumsum(steps[letters])
        level = int(levels[-1])
        if levels.max() > _MAX_LEVELS:
            raise ContentError(f"has more than {_MAX_LEVELS} nested brackets", "it is malformed", "write it flatter")


def _integer(word: str) -> int | float:
    """Parse a JSON integer; use a float beyond 18 digits.

    The float of a very long number is infinite.
    """
    return int(word) if len(word) < 19 else float(word)


def _not_plain(event: Any, what: str) -> ContentError:
    problem, rule = f"has {what} in line {event.start_mark.line + 1}", "only text, numbers, lists and tables are read"
    return ContentError(problem, rule, "correct that line")


_XACRO_NAMESPACES: Final = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}")
"""Namespaces of xacro's elements. A file that xacro expanded may still declare one."""


def check_expanded(root: Element) -> None:
    """Raise ContentError if a file holds unexpanded xacro macros."""
    if any(str(element.tag).startswith(_XACRO_NAMESPACES) for element in root.iter()):
        raise ContentError("holds xacro macros", "expand them first", "run xacro robot.urdf.xacro > robot.urdf")
