"""Robots from URDF files: the collision geometry of links, placed where their joints are at zero."""

from __future__ import annotations

import io
import logging
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from cspace.arrays import Floats
from cspace.errors import FileError, InputError, optional, warn_user
from cspace.files.access import Fault, decoding, read_bytes
from cspace.files.plain import check_expanded, parse_xml

if TYPE_CHECKING:
    from yourdfpy import URDF

_KIND: Final = "URDF"

GEOMETRIES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("filename",),
}
"""Shapes of collision geometry, and the attributes that each must have."""


_NUMBERS: Final[Mapping[str, Mapping[str, int]]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
}
"""Attributes that hold numbers, and how many."""


PackageDirs: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]]"


_PACKAGE_SCHEMES: Final = ("package", "model")
"""Schemes of names that begin with the name of a package."""

_LISTED: Final = 3
"""Meshes that a warning names, at most."""


def load_urdf(path: str | os.PathLike[str]) -> URDF:
    """The file as yourdfpy reads it, once it is known to hold what that takes for granted."""
    yourdfpy = optional("yourdfpy", "URDF files are read with it", "urdf")
    # What it logs is said by the errors here.
    logging.getLogger("yourdfpy").addHandler(logging.NullHandler())
    data = read_bytes(path, _KIND, memory=20.0)
    with decoding(path, _KIND):
        root = parse_xml(data)
        _check(root)
        plain = io.BytesIO(ElementTree.tostring(root))
        # Without its scene graphs: placing the links of a long chain by them takes cubic time.
        return yourdfpy.URDF.load(plain, load_meshes=False, build_scene_graph=False, build_collision_scene_graph=False)


def find_meshes(
    urdf: URDF, links: Iterable[str], path: str | os.PathLike[str], package_dirs: Sequence[Path]
) -> dict[str, Path]:
    """Find the mesh files of links, before any of them is read; return each by its name in the URDF.

    The order of the search is that of :meth:`cspace.Robot.from_urdf`. One warning names the files that were found only
    elsewhere than their names say.

    Raises FileError if a mesh is missing, or several files could be meant.
    """
    places: dict[str, str] = {}
    for link in links:
        for number, collision in enumerate(urdf.link_map[link].collisions):
            if collision.geometry.mesh is not None:
                places.setdefault(str(collision.geometry.mesh.filename), f"link {link!r}, collision {number}")
    return locate_meshes(places, path, package_dirs)


def locate_meshes(
    places: Mapping[str, str], path: str | os.PathLike[str], package_dirs: Sequence[Path]
) -> dict[str, Path]:
    """Find the mesh files that a file names, as :func:`find_meshes` does.

    ``places`` says for each name, in messages, where the file has it.
    """
    folder = Path(path).resolve().parent
    meshes: dict[str, Path] = {}
    guesses: dict[str, Path] = {}
    for name, place in places.items():
        exact, elsewhere = _places(name, folder, package_dirs)
        if not (found := _files(exact)[:1]):
            found = _files(elsewhere)
            _check_single(found, f"{os.fspath(path)}: {place}: mesh {name}", folder)
            guesses[name] = found[0]
        meshes[name] = found[0]
    if guesses:
        listed = [f"{name} from {file}" for name, file in list(guesses.items())[:_LISTED]]
        more = f" and {len(guesses) - _LISTED} more" if len(guesses) > _LISTED else ""
        warn_user(
            f"{os.fspath(path)}: no mesh is where its name says; read instead, as the only file with the rest of the "
            f"name: {', '.join(listed)}{more}; if this is wrong, pass package_dirs=FOLDER, where FOLDER holds the "
            "folder of the package"
        )
    return meshes


def _check(root: Element) -> None:
    """Refuse what would be read in part, or misread."""
    if root.tag != "robot":
        raise Fault(f"holds <{root.tag:.60}>, not <robot>", "a URDF file describes a robot", "pass the right file")
    check_expanded(root)
    names = [str(element.get("name")) for element in root.findall("link")]
    if not names:
        raise Fault("has no <link>", "a robot has one at least", "pass the right file")
    for kind, given in (("link", names), ("joint", [str(joint.get("name")) for joint in root.findall("joint")])):
        if twice := [name for name, times in Counter(given).items() if times > 1]:
            raise Fault(f"has more than one {kind} {twice[0]!r}", "each has a name of its own", "rename one")
        for element in root.findall(kind):
            _check_numbers(element, f"{kind} {element.get('name')!r}")
    parents: dict[str, str] = {}
    known = set(names)
    for joint in root.findall("joint"):
        links = [getattr(joint.find(end), "attrib", {}).get("link") for end in ("parent", "child")]
        if not all(end in known for end in links):
            fault = f"joins {links[0]!r} to {links[1]!r} by the joint {joint.get('name')!r}"
            raise Fault(fault, "both must be links of it", "correct the names")
        axis = getattr(joint.find("axis"), "attrib", {}).get("xyz", "1")
        if joint.get("type") != "fixed" and not any(word.strip("+-0.eE") for word in axis.split()):
            raise Fault(f"has the axis {axis!r} at the joint {joint.get('name')!r}", "it is not zero", "correct it")
        parent, child = map(str, links)
        if child in parents:
            raise Fault(
                f"joins {child!r} to {parents[child]!r} and {parent!r}", "a link has one parent", "drop a joint"
            )
        parents[child] = parent
    rooted: set[str] = set()
    for name in names:
        above, child = {name}, name
        while child in parents and child not in rooted:
            child = parents[child]
            if child in above:
                raise Fault(f"joins {name!r} in a loop of joints", "links are a tree", "drop a joint")
            above.add(child)
        rooted |= above
    if len(names) - len(parents) != 1:
        loose = ", ".join(name for name in names if name not in parents) or "none"
        raise Fault(f"has these links without a parent: {loose}", "one is the root of all others", "join them")
    for link in root.findall("link"):
        for number, collision in enumerate(link.findall("collision")):
            _check_geometry(collision.find("geometry"), f"link {link.get('name')!r}, collision {number}")


def _check_numbers(element: Element, place: str) -> None:
    """Refuse what is no number, or not as many, in a link or a joint."""
    for part in element.iter():
        for name, count in _NUMBERS.get(str(part.tag), {}).items():
            text = part.get(name, " ".join("0" * count))
            try:
                numbers = [float(word) for word in text.split()]
            except ValueError:
                numbers = []
            if len(numbers) not in {count, 1 if name == "scale" else count}:
                rule = "it must be one number" if count == 1 else f"it must be {count} numbers"
                raise Fault(f"has {name}={text!r} at the {part.tag} of {place}", rule, "correct it")


def _check_geometry(geometry: Element | None, place: str) -> None:
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in GEOMETRIES:
        kinds = ", ".join(f"<{shape.tag:.40}>" for shape in shapes) or "nothing"
        raise Fault(f"has {kinds} as the geometry of {place}", f"it is one of {', '.join(GEOMETRIES)}", "correct it")
    for name in GEOMETRIES[shapes[0].tag]:
        if name not in shapes[0].attrib:
            raise Fault(f"lacks the {name} of the {shapes[0].tag} of {place}", "it must be there", "add it")


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
    """The root and the links that only fixed joints part from it."""
    rigid, below = [root_link(urdf)], _children(urdf)
    for name in rigid:  # which grows meanwhile
        rigid += [joint.child for joint in below[name] if joint.type == "fixed"]
    return rigid


def zero_poses(urdf: URDF) -> dict[str, Floats]:
    """Return the pose of each link in the frame of the root, shape (4, 4), with the joints at zero.

    A joint that mimics another one is at its offset.
    """
    from scipy.spatial.transform import Rotation

    root, below = root_link(urdf), _children(urdf)
    poses, order = {root: np.eye(4)}, [root]
    for name in order:  # which grows meanwhile
        for joint in below[name]:
            motion = np.eye(4)
            offset = joint.mimic.offset if joint.mimic is not None else None
            if offset and joint.type in ("revolute", "continuous"):
                motion[:3, :3] = Rotation.from_rotvec(offset * joint.axis / np.linalg.norm(joint.axis)).as_matrix()
            elif offset and joint.type == "prismatic":
                motion[:3, 3] = offset * joint.axis / np.linalg.norm(joint.axis)
            poses[joint.child] = poses[name] @ (np.eye(4) if joint.origin is None else joint.origin) @ motion
            order.append(joint.child)
    return poses


def package_folders(package_dirs: PackageDirs) -> list[Path]:
    """Return the folders of ``package_dirs``, which may be a single one."""
    try:
        folders = [Path(package_dirs)] if isinstance(package_dirs, str | os.PathLike) else [*map(Path, package_dirs)]
    except TypeError as error:
        rule = "it must be a folder, or a list of folders"
        raise InputError("package_dirs", f"is {package_dirs!r}", rule, "pass paths", value=package_dirs) from error
    for folder in folders:
        if not os.path.isdir(folder):  # noqa: PTH112 - Path.is_dir raises OSError for some names
            rule = "each must be an existing folder that holds the folders of packages"
            raise InputError("package_dirs", f"names {folder}", rule, "correct its name", value=folder)
    return folders


def _places(name: str, folder: Path, package_dirs: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return where the file of a mesh may be, in order, and where it may be if the name is not exact.

    ``folder`` is that of the URDF.
    """
    scheme, _, rest = name.rpartition("://")
    above = [folder, *folder.parents]
    if scheme not in _PACKAGE_SCHEMES:
        return [folder / rest], [each / rest for each in (*package_dirs, *above)]
    variables = [
        Path(each) / tail
        for variable, tail in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
        for each in os.environ.get(variable, "").split(os.pathsep)
        if each
    ]
    inside = rest.partition("/")[2]
    return [each / rest for each in (*package_dirs, *above, *variables)], [
        each / inside for each in (*package_dirs, *above)
    ]


def _files(places: Iterable[Path]) -> list[Path]:
    """Return the places that are files, without repetitions."""
    files: dict[Path, Path] = {}
    for place in places:
        with suppress(OSError):  # a name that no file can have
            if place.is_file():
                files.setdefault(place.resolve(), place)
    return list(files.values())


def _check_single(found: Sequence[Path], place: str, folder: Path) -> None:
    """Refuse a mesh with no file, or with several files that could be meant."""
    hint = "put it there, correct its name, or pass package_dirs=FOLDER, where FOLDER holds the folder of its package"
    if not found:
        rule = (
            f"it is looked for in package_dirs, {folder} and the folders above it, ROS_PACKAGE_PATH and "
            "AMENT_PREFIX_PATH"
        )
        raise FileError(place, "does not exist", rule, hint)
    if len(found) > 1:
        rule = f"several files could be meant: {', '.join(map(str, found))}"
        raise FileError(place, "does not exist under its whole name", rule, hint)
