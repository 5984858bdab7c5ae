"""SRDF files: which links may touch, groups of joints, their named states, and end effectors."""

from __future__ import annotations

import math
import os
from collections.abc import Container, Iterable, Iterator
from typing import TYPE_CHECKING, Final, NamedTuple
from xml.etree.ElementTree import Element

from cspace.errors import warn_user
from cspace.files.access import Fault, decoding, read_bytes
from cspace.files.plain import check_expanded, parse_xml

if TYPE_CHECKING:
    from yourdfpy import URDF

_KIND: Final = "SRDF"

_MOVING: Final = ("revolute", "continuous", "prismatic")
"""Types of joints with one value."""


class EndEffector(NamedTuple):
    """An end effector of an SRDF.

    Attributes
    ----------
    parent_link : str
        The link that carries it.
    group : str
        Group of its own joints.
    parent_group : str
        Group of the joints that move it; empty if the SRDF does not say.
    """

    parent_link: str
    group: str
    parent_group: str


class Srdf(NamedTuple):
    """The content of an SRDF.

    Attributes
    ----------
    allowed : dict of (str, str) to str
        Pairs of links that may touch, each in the order of the alphabet, and why.
    groups : dict of str to set of str
        Joints of each group.
    states : dict of str to dict of str to float
        Values of the joints that turn or slide, by ``GROUP/STATE``, or by ``STATE`` if it has no group. States without
        a known joint are left out.
    end_effectors : dict of str to EndEffector
    """

    allowed: dict[tuple[str, str], str]
    groups: dict[str, set[str]]
    states: dict[str, dict[str, float]]
    end_effectors: dict[str, EndEffector]


def read_srdf(path: str | os.PathLike[str], urdf: URDF) -> Srdf:
    """Read the SRDF of a robot.

    What names links or joints that the URDF does not have is skipped, and so are pairs that name a link without
    collision geometry. One warning lists them all.

    Raises FileError if the file is missing or malformed.
    """
    data = read_bytes(path, _KIND, memory=20.0)
    with decoding(path, _KIND):
        root = parse_xml(data)
        if root.tag != "robot":
            raise Fault(f"holds <{root.tag:.60}>, not <robot>", "an SRDF file describes a robot", "pass the right file")
        check_expanded(root)
        reader = _Reader(root, urdf)
        srdf = Srdf(reader.allowed(), reader.groups(), reader.states(), reader.end_effectors())
    skipped = []
    if reader.unknown:
        skipped.append(f"{', '.join(reader.unknown)}, which the URDF does not have")
    if reader.bare:
        skipped.append(f"{', '.join(reader.bare)}, without collision geometry")
    if skipped:
        warn_user(f"{os.fspath(path)}: names {'; and '.join(skipped)}; such pairs, members and values are skipped")
    return srdf


class _Reader:
    """Elements of an SRDF beside the links and joints of the URDF."""

    def __init__(self, root: Element, urdf: URDF) -> None:
        self._root, self._links = root, urdf.link_map
        self._above = {joint.child: joint for joint in urdf.robot.joints}
        self._kinds = {joint.name: joint.type for joint in urdf.robot.joints}
        self._kinds |= {_attribute(each, "name"): "virtual" for each in root.iter("virtual_joint")}
        self.unknown: dict[str, None] = {}
        self.bare: dict[str, None] = {}

    def _known(self, names: Iterable[str], there: Container[str]) -> bool:
        """Return whether all names are there; note the others."""
        missing = [name for name in names if name not in there]
        self.unknown |= dict.fromkeys(missing)
        return not missing

    def allowed(self) -> dict[tuple[str, str], str]:
        """Return the pairs that may touch; like MoveIt, apply defaults first, then what is enabled, then disabled."""
        solid = {name: None for name, link in self._links.items() if link.collisions}
        allowed: dict[tuple[str, str], str] = {}
        for (name,), why in self._named("disable_default_collisions", "link"):
            allowed |= {_sorted(name, other): why for other in solid if name in solid and other != name}
        for (one, other), _ in self._named("enable_collisions", "link1", "link2"):
            allowed.pop(_sorted(one, other), None)
        for (one, other), why in self._named("disable_collisions", "link1", "link2"):
            self.bare |= dict.fromkeys(name for name in (one, other) if name not in solid)
            if one in solid and other in solid:
                allowed[_sorted(one, other)] = why
        return allowed

    def _named(self, tag: str, *keys: str) -> Iterator[tuple[tuple[str, ...], str]]:
        """Yield the links that elements name, if the URDF has all of them, and the reason."""
        for element in self._root.iter(tag):
            names = tuple(_attribute(element, key) for key in keys)
            if self._known(names, self._links):
                yield names, element.get("reason") or _KIND

    def groups(self) -> dict[str, set[str]]:
        elements = {_attribute(each, "name"): each for each in self._root.findall("group")}
        return {name: self._members(name, elements, frozenset()) for name in elements}

    def _members(self, name: str, elements: dict[str, Element], within: frozenset[str]) -> set[str]:
        """Return the joints of a group and of its subgroups; ``within`` are the groups that it is a part of."""
        if name in within:
            raise Fault(f"has the group {name!r} within itself", "subgroups end somewhere", "drop one of them")
        joints: set[str] = set()
        for part in elements[name]:
            if part.tag == "joint" and self._known([each := _attribute(part, "name")], self._kinds):
                joints.add(each)
            elif part.tag == "link" and self._known([each := _attribute(part, "name")], self._links):
                joints |= {self._above[each].name} if each in self._above else set()
            elif part.tag == "chain":
                ends = _attribute(part, "base_link"), _attribute(part, "tip_link")
                if self._known(ends, self._links):
                    joints |= self._to_root(ends[0]) ^ self._to_root(ends[1])
            elif part.tag == "group" and self._known([each := _attribute(part, "name")], elements):
                joints |= self._members(each, elements, within | {name})
        return joints

    def _to_root(self, link: str) -> set[str]:
        """Return the joints between a link and the root."""
        joints = set()
        while link in self._above:
            joints.add(self._above[link].name)
            link = self._above[link].parent
        return joints

    def states(self) -> dict[str, dict[str, float]]:
        states = {}
        for state in self._root.findall("group_state"):
            name = "/".join(filter(None, (state.get("group"), _attribute(state, "name"))))
            values = {_attribute(each, "name"): _attribute(each, "value") for each in state.findall("joint")}
            if not self._known(values, self._kinds) and values.keys().isdisjoint(self._kinds):
                continue
            moving = [joint for joint in values if self._kinds.get(joint) in _MOVING]
            states[name] = {joint: _number(values[joint], name, joint) for joint in moving}
        return states

    def end_effectors(self) -> dict[str, EndEffector]:
        effectors = {}
        for each in self._root.findall("end_effector"):
            link, group = _attribute(each, "parent_link"), _attribute(each, "group")
            if self._known([link], self._links):
                effectors[_attribute(each, "name")] = EndEffector(link, group, each.get("parent_group", ""))
        return effectors


def _number(text: str, state: str, joint: str) -> float:
    """Return the value of a joint in a named state."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise Fault(f"has {joint} at {text!r} in the state {state!r}", "it must be one finite number", "correct it")
    return value


def _attribute(element: Element, key: str) -> str:
    """Return an attribute that must be there."""
    value = element.get(key)
    if value is None:
        raise Fault(f"has a <{element.tag}> without {key}", "it must be there", "add it")
    return value


def _sorted(one: str, other: str) -> tuple[str, str]:
    return (one, other) if one < other else (other, one)
