"""Robots from URDF files, and additions from SRDF files.

SRDF files add allowed contacts, groups, named states and end effectors.
"""

from __future__ import annotations

import io
import logging
import math
import os
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from cspace.errors import FileError, InputError, import_optional, warn_user
from cspace.files.access import ContentError, decoding, read_bytes
from cspace.files.plain import check_expanded, parse_xml
from cspace.support.arrays import Floats

if TYPE_CHECKING:
    from yourdfpy import URDF

_URDF_KIND: Final = "URDF"
"""Kind of file, for messages."""

GEOMETRIES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("filename",),
}
"""Required attributes of each type of collision geometry."""


_NUMBERS_PER_ATTRIBUTE: Final[Mapping[str, Mapping[str, int]]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "velocity": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
}
"""Number of values of each numeric attribute, by element and attribute."""


PackageDirs: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]]"
"""One folder, or several, that hold the folders of packages."""


_PACKAGE_SCHEMES: Final = ("package", "model")
"""Schemes of mesh names that start with the name of a package."""

_MAX_LISTED_MESHES: Final = 3
"""Largest number of meshes that a warning names."""


def load_urdf(path: str | os.PathLike[str]) -> URDF:
    """Load a URDF with yourdfpy.

    Its structure is checked first, because yourdfpy assumes that it is right.

    Raises MissingPackageError without yourdfpy, and FileError if the file is missing or malformed.
    """
    yourdfpy = import_optional("yourdfpy", "URDF files are read with it", "urdf")
    # Silence its log, because the errors here give the same reasons.
    logging.getLogger("yourdfpy").addHandler(logging.NullHandler())
    data = read_bytes(path, _URDF_KIND, 20.0, "max_description_bytes")
    with decoding(path, _URDF_KIND):
        root = parse_xml(data)
        _check_robot(root)
        plain = io.BytesIO(ElementTree.tostring(root))
        # Omit its scene graphs, because they take cubic time for a long chain of links.
        return yourdfpy.URDF.load(
            plain, load_meshes=False, build_scene_graph=False, build_collision_scene_graph=False
        )


def find_meshes(
    urdf: URDF, links: Iterable[str], path: str | os.PathLike[str], package_dirs: Sequence[Path]
) -> dict[str, Path]:
    """Find the mesh files of links, by name.

    The files are not read. The search order is documented at :meth:`cspace.Robot.from_urdf`. One
    warning lists the files that were found only under a part of their names.

    Raises FileError if a mesh is missing or ambiguous.
    """
    places: dict[str, str] = {}
    for link in links:
        for number, collision in enumerate(urdf.link_map[link].collisions):
            if collision.geometry.mesh is not None:
                places.setdefault(
                    str(collision.geometry.mesh.filename), f"link {link!r}, collision {number}"
                )
    return locate_meshes(places, path, package_dirs)


def locate_meshes(
    places: Mapping[str, str], path: str | os.PathLike[str], package_dirs: Sequence[Path]
) -> dict[str, Path]:
    """Find the mesh files that a file names.

    See :func:`find_meshes` for the search. ``places`` has, for each mesh, its place in the file,
    for messages.
    """
    folder = Path(path).resolve().parent
    meshes: dict[str, Path] = {}
    guesses: dict[str, Path] = {}
    for name, place in places.items():
        exact, elsewhere = _candidate_paths(name, folder, package_dirs)
        if not (found := _existing_files(exact)[:1]):
            found = _existing_files(elsewhere)
            _check_single(found, f"{os.fspath(path)}: {place}: mesh {name}", folder)
            guesses[name] = found[0]
        meshes[name] = found[0]
    if guesses:
        listed = [
            f"{name} from {file}" for name, file in list(guesses.items())[:_MAX_LISTED_MESHES]
        ]
        more = (
            f" and {len(guesses) - _MAX_LISTED_MESHES} more"
            if len(guesses) > _MAX_LISTED_MESHES
            else ""
        )
        warn_user(
            f"{os.fspath(path)}: meshes are missing under their full names; the only file with "
            "the rest of the name is "
            f"read instead: {', '.join(listed)}{more}; if this is wrong, pass "
            "package_dirs=FOLDER, where FOLDER holds "
            "the folder of the package"
        )
    return meshes


def _check_robot(root: Element) -> None:
    """Refuse a URDF that yourdfpy would misread.

    Raises ContentError.
    """
    if root.tag != "robot":
        raise ContentError(
            f"holds <{root.tag:.60}>, not <robot>",
            "a URDF file describes a robot",
            "pass the right file",
        )
    check_expanded(root)
    names = _read_names(root, "link")
    if not names:
        raise ContentError("has no <link>", "a robot needs one", "pass the right file")
    for kind in ("link", "joint"):
        _check_unique(_read_names(root, kind), kind)
        for element in root.findall(kind):
            _check_numbers(element, f"{kind} {element.get('name')!r}")
    _check_tree(names, _find_parents(root, set(names)))
    for link in root.findall("link"):
        for number, collision in enumerate(link.findall("collision")):
            _check_geometry(
                collision.find("geometry"), f"link {link.get('name')!r}, collision {number}"
            )


def _read_names(root: Element, kind: str) -> list[str]:
    """Return the names of the links or joints of a robot."""
    return [str(element.get("name")) for element in root.findall(kind)]


def _check_unique(names: list[str], kind: str) -> None:
    """Refuse a name that occurs twice."""
    repeated = [name for name, times in Counter(names).items() if times > 1]
    if repeated:
        raise ContentError(
            f"has more than one {kind} {repeated[0]!r}", "names must be unique", "rename one"
        )


def _find_parents(root: Element, links: set[str]) -> dict[str, str]:
    """Return the parent of each link but the roots.

    Refuses joints of unknown links or without an axis, and links with two parents.
    """
    parents: dict[str, str] = {}
    for joint in root.findall("joint"):
        name = joint.get("name")
        parent, child = (_read_attribute(joint, end, "link") for end in ("parent", "child"))
        if parent not in links or child not in links:
            raise ContentError(
                f"joins {parent!r} to {child!r} by the joint {name!r}",
                "both must be links of the robot",
                "correct the names",
            )
        axis = _read_attribute(joint, "axis", "xyz") or "1 0 0"
        if joint.get("type") != "fixed" and np.linalg.norm([*map(float, axis.split())]) == 0.0:
            raise ContentError(
                f"has the axis {axis!r} at the joint {name!r}", "it must not be zero", "correct it"
            )
        if child in parents:
            raise ContentError(
                f"joins {child!r} to {parents[child]!r} and {parent!r}",
                "a link has one parent",
                "remove a joint",
            )
        parents[child] = parent
    return parents


def _read_attribute(element: Element, tag: str, name: str) -> str | None:
    """Return an attribute of a part of an element, or None."""
    part = element.find(tag)
    return None if part is None else part.get(name)


def _check_tree(names: list[str], parents: dict[str, str]) -> None:
    """Refuse links that form a loop or have several roots."""
    try:
        TopologicalSorter({child: [parent] for child, parent in parents.items()}).prepare()
    except CycleError as error:
        problem = f"joins {error.args[1][0]!r} in a loop of joints"
        raise ContentError(problem, "links must form a tree", "remove a joint") from error
    roots = [name for name in names if name not in parents]
    if len(roots) != 1:
        problem = f"has these links without a parent: {', '.join(roots)}"
        raise ContentError(problem, "there must be one root", "join the others")


def _check_numbers(element: Element, place: str) -> None:
    """Refuse attributes with a wrong count of numbers.

    Raises ContentError. ``place`` names the element in messages.
    """
    for part in element.iter():
        for name, count in _NUMBERS_PER_ATTRIBUTE.get(str(part.tag), {}).items():
            text = part.get(name, " ".join("0" * count))
            try:
                numbers = [float(word) for word in text.split()]
            except ValueError:
                numbers = []
            if len(numbers) not in {count, 1 if name == "scale" else count}:
                raise ContentError(
                    f"has {name}={text!r} at the {part.tag} of {place}",
                    "it must be one number" if count == 1 else f"it must be {count} numbers",
                    "correct it",
                )


def _check_geometry(geometry: Element | None, place: str) -> None:
    """Refuse a collision geometry that is not one known shape.

    Raises ContentError. ``place`` names the geometry in messages.
    """
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in GEOMETRIES:
        kinds = ", ".join(f"<{shape.tag:.40}>" for shape in shapes) or "nothing"
        raise ContentError(
            f"has {kinds} as the geometry of {place}",
            f"it must be one of {', '.join(GEOMETRIES)}",
            "correct it",
        )
    for name in GEOMETRIES[shapes[0].tag]:
        if name not in shapes[0].attrib:
            raise ContentError(
                f"lacks the {name} of the {shapes[0].tag} of {place}", "it must be there", "add it"
            )


def root_link(urdf: URDF) -> str:
    """Return the link without a parent."""
    children = {joint.child for joint in urdf.robot.joints}
    return next(str(name) for name in urdf.link_map if name not in children)


def _children(urdf: URDF) -> dict[str, list[Any]]:
    """Return the joints below each link."""
    below: dict[str, list[Any]] = {name: [] for name in urdf.link_map}
    for joint in urdf.robot.joints:
        below[joint.parent].append(joint)
    return below


def fixed_links(urdf: URDF) -> list[str]:
    """List the links that are fixed to the root.

    The root comes first.
    """
    rigid = [root_link(urdf)]
    below = _children(urdf)
    for name in rigid:  # the list grows in the loop
        rigid += [joint.child for joint in below[name] if joint.type == "fixed"]
    return rigid


def zero_poses(urdf: URDF) -> dict[str, Floats]:
    """Return the pose of each link at zero joints.

    Poses are matrices, shape (4, 4), relative to the root. A joint that mimics another one is at
    its offset.
    """
    from scipy.spatial.transform import Rotation

    root = root_link(urdf)
    below = _children(urdf)
    poses = {root: np.eye(4)}
    order = [root]
    for name in order:  # the list grows in the loop
        for joint in below[name]:
            pose = poses[name] @ (np.eye(4) if joint.origin is None else joint.origin)
            if joint.mimic is not None and joint.type in _MOVING_TYPES:
                motion = np.eye(4)
                step = joint.mimic.offset * joint.axis / np.linalg.norm(joint.axis)
                if joint.type == "prismatic":
                    motion[:3, 3] = step
                else:
                    motion[:3, :3] = Rotation.from_rotvec(step).as_matrix()
                pose = pose @ motion
            poses[joint.child] = pose
            order.append(joint.child)
    return poses


def package_folders(package_dirs: PackageDirs) -> list[Path]:
    """Return package folders as a list of paths.

    ``package_dirs`` is one folder or several.

    Raises InputError if it is of another type or a folder is missing.
    """
    try:
        folders = (
            [Path(package_dirs)]
            if isinstance(package_dirs, str | os.PathLike)
            else [*map(Path, package_dirs)]
        )
    except TypeError as error:
        raise InputError(
            "package_dirs",
            f"is {package_dirs!r}",
            "it must be a folder, or a list of folders",
            "pass paths",
            value=package_dirs,
        ) from error
    for folder in folders:
        if not os.path.isdir(folder):  # noqa: PTH112 - Path.is_dir raises OSError for some names
            raise InputError(
                "package_dirs",
                f"names {folder}",
                "each must be an existing folder that holds the folders of packages",
                "correct its name",
                value=folder,
            )
    return folders


def _candidate_paths(
    name: str, folder: Path, package_dirs: Sequence[Path]
) -> tuple[list[Path], list[Path]]:
    """Return the candidate paths of a mesh.

    The first list has the paths for its full name, in order of preference; the second list has
    paths for a part of the name. `folder` is the folder of the URDF.
    """
    scheme, _, relative = name.rpartition("://")
    folders_above = [folder, *folder.parents]
    if scheme not in _PACKAGE_SCHEMES:
        return [folder / relative], [each / relative for each in (*package_dirs, *folders_above)]
    variables = [
        Path(each) / tail
        for variable, tail in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
        for each in os.environ.get(variable, "").split(os.pathsep)
        if each
    ]
    inside_package = relative.partition("/")[2]
    return [each / relative for each in (*package_dirs, *folders_above, *variables)], [
        each / inside_package for each in (*package_dirs, *folders_above)
    ]


def _existing_files(places: Iterable[Path]) -> list[Path]:
    """Return the paths that are files, without duplicates."""
    files: dict[Path, Path] = {}
    for place in places:
        with suppress(OSError):  # a name that no file can have
            if place.is_file():
                files.setdefault(place.resolve(), place)
    return list(files.values())


def _check_single(found: Sequence[Path], place: str, folder: Path) -> None:
    """Raise FileError unless a mesh has one file."""
    hint = (
        "put it there, correct its name, or pass package_dirs=FOLDER, where FOLDER holds the "
        "folder of its package"
    )
    if not found:
        places = (
            f"package_dirs, {folder} and the folders above it, ROS_PACKAGE_PATH and "
            "AMENT_PREFIX_PATH"
        )
        raise FileError(place, "does not exist", f"the search covers {places}", hint)
    if len(found) > 1:
        raise FileError(
            place,
            "does not exist under its full name",
            f"several files match a part of it: {', '.join(map(str, found))}",
            hint,
        )


_SRDF_KIND: Final = "SRDF"
"""Kind of file, for messages."""

_MOVING_TYPES: Final = ("revolute", "continuous", "prismatic")
"""Types of joints with one value."""


class EndEffector(NamedTuple):
    """An end effector of an SRDF.

    Attributes
    ----------
    parent_link : str
        Link that carries it.
    group : str
        Group of the effector's joints.
    parent_group : str
        Group of the joints that move it; empty if undeclared.
    """

    parent_link: str
    group: str
    parent_group: str


class Srdf(NamedTuple):
    """The content of an SRDF.

    Attributes
    ----------
    allowed : dict of (str, str) to str
        Reason for each pair of links that may touch; the links of a pair are in alphabetical order.
    groups : dict of str to set of str
        Joints of each group.
    states : dict of str to dict of str to float
        Values of the revolute and prismatic joints, by ``GROUP/STATE``, or by ``STATE`` without a
        group. States without known joints are omitted.
    end_effectors : dict of str to EndEffector
    """

    allowed: dict[tuple[str, str], str]
    groups: dict[str, set[str]]
    states: dict[str, dict[str, float]]
    end_effectors: dict[str, EndEffector]


def read_srdf(path: str | os.PathLike[str], urdf: URDF) -> Srdf:
    """Read the SRDF of a robot.

    Elements that name unknown links or joints are skipped, and so are pairs with a link without
    collision geometry. One warning lists all skipped names.

    Raises FileError if the file is missing or malformed.
    """
    data = read_bytes(path, _SRDF_KIND, 20.0, "max_description_bytes")
    with decoding(path, _SRDF_KIND):
        root = parse_xml(data)
        if root.tag != "robot":
            raise ContentError(
                f"holds <{root.tag:.60}>, not <robot>",
                "an SRDF file describes a robot",
                "pass the right file",
            )
        check_expanded(root)
        reader = _Reader(root, urdf)
        srdf = Srdf(reader.allowed(), reader.groups(), reader.states(), reader.end_effectors())
    skipped = []
    if reader.unknown:
        skipped.append(f"{', '.join(reader.unknown)}, which the URDF does not have")
    if reader.bare:
        skipped.append(f"{', '.join(reader.bare)}, without collision geometry")
    if skipped:
        warn_user(
            f"{os.fspath(path)}: names {'; and '.join(skipped)}; such pairs, members and values "
            "are skipped"
        )
    return srdf


class _Reader:
    """Parser of an SRDF that collects unknown names.

    ``unknown`` holds names that the URDF lacks, ``bare`` links without collision geometry.
    """

    def __init__(self, root: Element, urdf: URDF) -> None:
        self._root = root
        self._links = urdf.link_map
        self._above = {joint.child: joint for joint in urdf.robot.joints}
        self._kinds = {joint.name: joint.type for joint in urdf.robot.joints}
        self._kinds |= {_attribute(each, "name"): "virtual" for each in root.iter("virtual_joint")}
        self.unknown: dict[str, None] = {}
        self.bare: dict[str, None] = {}

    def _known(self, names: Iterable[str], there: Container[str]) -> bool:
        """Return True if all names are known.

        They are known if they are in `there`; other names are collected in ``unknown``.
        """
        missing = [name for name in names if name not in there]
        self.unknown |= dict.fromkeys(missing)
        return not missing

    def allowed(self) -> dict[tuple[str, str], str]:
        """Return the pairs of links that may touch.

        Each has its reason. Like MoveIt, apply the defaults first, then enabled, then disabled
        pairs.
        """
        solid = {name: None for name, link in self._links.items() if link.collisions}
        allowed: dict[tuple[str, str], str] = {}
        for (name,), why in self._named("disable_default_collisions", "link"):
            allowed |= {
                _sorted_pair(name, other): why for other in solid if name in solid and other != name
            }
        for (one, other), _ in self._named("enable_collisions", "link1", "link2"):
            allowed.pop(_sorted_pair(one, other), None)
        for (one, other), why in self._named("disable_collisions", "link1", "link2"):
            self.bare |= dict.fromkeys(name for name in (one, other) if name not in solid)
            if one in solid and other in solid:
                allowed[_sorted_pair(one, other)] = why
        return allowed

    def _named(self, tag: str, *keys: str) -> Iterator[tuple[tuple[str, ...], str]]:
        """Yield the known links that elements name.

        Each item has the names of the links, and the reason of the element.
        """
        for element in self._root.iter(tag):
            names = tuple(_attribute(element, key) for key in keys)
            if self._known(names, self._links):
                yield names, element.get("reason") or _SRDF_KIND

    def groups(self) -> dict[str, set[str]]:
        """Return the joints of each group."""
        elements = {_attribute(each, "name"): each for each in self._root.findall("group")}
        return {name: self._members(name, elements, frozenset()) for name in elements}

    def _members(self, name: str, elements: dict[str, Element], within: frozenset[str]) -> set[str]:
        """Return the joints of a group and its subgroups.

        `within` holds the enclosing groups.
        """
        if name in within:
            raise ContentError(
                f"has the group {name!r} within itself", "subgroups must end", "remove one of them"
            )
        joints: set[str] = set()
        for part in elements[name]:
            if part.tag == "joint" and self._known([each := _attribute(part, "name")], self._kinds):
                joints.add(each)
            elif part.tag == "link" and self._known(
                [each := _attribute(part, "name")], self._links
            ):
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
        """Return the named states, without unknown joints."""
        states = {}
        for state in self._root.findall("group_state"):
            name = "/".join(filter(None, (state.get("group"), _attribute(state, "name"))))
            values = {
                _attribute(each, "name"): _attribute(each, "value")
                for each in state.findall("joint")
            }
            if not self._known(values, self._kinds) and values.keys().isdisjoint(self._kinds):
                continue
            moving = [joint for joint in values if self._kinds.get(joint) in _MOVING_TYPES]
            states[name] = {joint: _parse_value(values[joint], name, joint) for joint in moving}
        return states

    def end_effectors(self) -> dict[str, EndEffector]:
        """Return the end effectors by name."""
        effectors = {}
        for each in self._root.findall("end_effector"):
            link = _attribute(each, "parent_link")
            group = _attribute(each, "group")
            if self._known([link], self._links):
                effectors[_attribute(each, "name")] = EndEffector(
                    link, group, each.get("parent_group", "")
                )
        return effectors


def _parse_value(text: str, state: str, joint: str) -> float:
    """Parse the value of a joint in a named state.

    Raises ContentError if it is not a finite number.
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ContentError(
            f"has {joint} at {text!r} in the state {state!r}",
            "it must be one finite number",
            "correct it",
        )
    return value


def _attribute(element: Element, key: str) -> str:
    """Return a required attribute.

    Raises ContentError if it is missing.
    """
    value = element.get(key)
    if value is None:
        raise ContentError(f"has a <{element.tag}> without {key}", "it must be there", "add it")
    return value


def _sorted_pair(one: str, other: str) -> tuple[str, str]:
    """Return two names in alphabetical order."""
    return (one, other) if one < other else (other, one)
