"""Robots from URDF files, and additions from SRDF files.

SRDF files add allowed contacts, groups, named states and end effectors.
"""

from __future__ import annotations

import itertools
import os
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np

from cspace.arms._checks import check_distinct
from cspace.arms._reading.sphere_files import parse_numbers, read_spheres, replace_geometry
from cspace.errors import FileError, InputError
from cspace.inside import (
    ContentError,
    Fields,
    Floats,
    Ledger,
    StrPath,
    decoding,
    read_xml,
    warn_user,
)

_BRING_YOUR_FILE: Final = 'the page "Bring your file" says how'
"""Hint for files that other packages convert."""

_URDF_KIND: Final = "URDF"
"""Kind of file, for messages."""

GEOMETRIES: Final[Mapping[str, tuple[str, ...]]] = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "mesh": ("filename",),
}
"""Required attributes of each type of collision geometry."""


FIELDS: Final = (
    Fields(
        "`.urdf`",
        honoured=(
            "`origin`; `axis`; `limit`; 0 where left out; `safety_controller` if narrower; "
            "`mimic`, except of limits; `scale` of meshes"
        ),
        refused="xacro; `quat_xyzw`; planar and floating joints below the base; capsules",
        warned=(
            "`visual` without `collision` (`visuals=True`); angles beyond a whole turn; `limit` "
            "without lower and upper, or of a continuous joint; `acceleration`, `deceleration` "
            "and `jerk` of `limit`; links that move against a rigid robot; elements and attributes "
            "that URDF lacks"
        ),
    ),
    Fields(
        "`.srdf`",
        honoured=(
            "`disable_collisions`, except with the reason Never; `enable_collisions`, "
            "`disable_default_collisions`; `group`, `group_state`"
        ),
        warned=(
            "names that the URDF lacks; another robot's name; links that often touch though the "
            "reason is Never; joints that move though they are `passive_joint`"
        ),
    ),
)

_NUMBERS_PER_ATTRIBUTE: Final[Mapping[str, Mapping[str, int]]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1, "velocity": 1},
    "safety_controller": {"soft_lower_limit": 1, "soft_upper_limit": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "mesh": {"scale": 3},
}
"""Number of values of each numeric attribute, by element and attribute."""

_PARTS: Final = {
    "robot": "name version link joint material transmission gazebo ros2_control",
    "link": "name type inertial visual collision contact self_collision_checking",
    "collision": "name origin geometry verbose contact_coefficients material",
    "geometry": "box cylinder sphere mesh",
    "box": "size",
    "cylinder": "radius length",
    "sphere": "radius",
    "mesh": "filename scale",
    "origin": "xyz rpy",
    "joint": (
        "name type origin parent child axis limit safety_controller mimic dynamics calibration "
        "hardwareInterface"
    ),
    "parent": "link",
    "child": "link",
    "axis": "xyz",
    "limit": "lower upper velocity effort",
    "safety_controller": "soft_lower_limit soft_upper_limit k_position k_velocity",
    "mimic": "joint multiplier offset",
}
"""Attributes and children of each element of a URDF that are read, or that move nothing."""

_SRDF_PARTS: Final = {
    "robot": (
        "name group group_state end_effector virtual_joint passive_joint disable_collisions "
        "enable_collisions disable_default_collisions link_sphere_approximation joint_property"
    ),
    "group": "name joint link chain group passive_joint",
    "group_state": "name group joint",
    "chain": "base_link tip_link",
    "joint": "name value",
    "end_effector": "name parent_link group parent_group",
    "passive_joint": "name",
    "disable_collisions": "link1 link2 reason",
    "enable_collisions": "link1 link2 reason",
    "disable_default_collisions": "link reason",
}
"""Attributes and children of each element of an SRDF that are read, or that move nothing."""

_SINGLE_PARTS: Final = ("origin", "geometry", "axis", "limit", "mimic", "parent", "child")
"""Elements that another one has once."""

_ANGLES_PER_TYPE: Final[Mapping[str, tuple[str, ...]]] = {
    "revolute": (
        *("rpy", "lower", "upper", "soft_lower_limit", "soft_upper_limit", "offset"),
        "velocity",
    ),
    "continuous": ("rpy", "offset", "velocity"),
}
"""Attributes that are angles, or their speed, by the type of joint; elsewhere only ``rpy`` is."""

_Places: TypeAlias = list[tuple[str, float, str]]
"""Numbers with their places in a file."""


PackageDirs: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]]"
"""One folder, or several, that hold the folders of packages."""


class Collision(NamedTuple):
    """A collision geometry of a link.

    Attributes
    ----------
    kind : str
        One of the types of geometry.
    sizes : list of float
        Sides, or radius and length, metres; factors of a mesh's scale.
    file : str
        Name of a mesh; empty for others.
    pose : ndarray of float64, shape (4, 4)
        In the frame of the link.
    """

    kind: str
    sizes: list[float]
    file: str
    pose: Floats


class LinkDescription(NamedTuple):
    """The geometries of a link."""

    collisions: list[Collision]
    is_drawn: bool  # whether it has visual geometry


class Mimic(NamedTuple):
    """The rule by which a joint follows another one."""

    leader: str
    factor: float
    offset: float  # radians or metres


class JointDescription(NamedTuple):
    """A joint of a URDF.

    ``limits`` and ``soft_limits`` have the numbers of `limit` and `safety_controller`, radians or
    metres and their speeds, by attribute; they are None without the element.
    """

    name: str
    type: str
    parent: str
    child: str
    frame: Floats  # on its parent link, (4, 4)
    axis: Floats  # of any length, (3,)
    limits: dict[str, float] | None
    soft_limits: dict[str, float] | None
    mimic: Mimic | None


class RobotDescription(NamedTuple):
    """The content of a URDF, by names of links and joints in the order of the file."""

    name: str
    links: dict[str, LinkDescription]
    joints: dict[str, JointDescription]


def load_urdf(
    path: str | os.PathLike[str],
    visuals: bool = False,
    spheres: str | os.PathLike[str] | None = None,
) -> RobotDescription:
    """Read a URDF.

    With ``visuals``, the visual geometry of a link without collision geometry becomes its collision
    geometry. A file of ``spheres`` replaces the collision geometry of the links that it names. A
    joint that mimics a mimicking joint mimics the leader of that joint instead.

    Raises FileError if the file is missing or malformed.
    """
    links = {} if spheres is None else read_spheres(spheres)
    root, path = _read_robot(path, _URDF_KIND), name_description(path)
    with decoding(path, _URDF_KIND):
        unknown = links.keys() - {link.get("name") for link in root.iter("link")}
        if unknown:
            warn_user(
                f"{spheres}: names links that the URDF lacks, which are skipped: "
                f"{', '.join(sorted(unknown))}"
            )
        replace_geometry(root, links)
        _choose_geometry(root, visuals)
        noted = _check_robot(root)
        _check_single_parts(root)
        ledger = _open_elements(root, FIELDS[0], _PARTS)
        joints = {_get_attribute(each, "name"): _read_joint(each) for each in root.findall("joint")}
        description = RobotDescription(
            root.get("name", Path(path).stem),
            {_get_attribute(each, "name"): _read_link(each) for each in root.findall("link")},
            _shorten_mimic_chains(joints),
        )
    ledger.noted = noted
    ledger.close(os.fspath(path))
    return description


def _read_link(link: Element) -> LinkDescription:
    """Read the geometries of a link whose numbers are checked."""
    collisions = []
    for collision in link.findall("collision"):
        (shape,) = collision.iterfind("geometry/*")
        names = ("scale",) if shape.tag == "mesh" else GEOMETRIES[shape.tag]
        sizes = [number for name in names for number in parse_numbers(shape.get(name, "1"))]
        file = shape.get("filename", "")
        collisions.append(Collision(shape.tag, sizes, file, _read_origin(collision)))
    return LinkDescription(collisions, link.find("visual") is not None)


def _read_joint(joint: Element) -> JointDescription:
    """Read a joint whose numbers are checked."""
    mimic = joint.find("mimic")
    return JointDescription(
        name=_get_attribute(joint, "name"),
        type=_get_attribute(joint, "type"),
        parent=str(_read_attribute(joint, "parent", "link")),
        child=str(_read_attribute(joint, "child", "link")),
        frame=_read_origin(joint),
        axis=np.array(parse_numbers(_read_attribute(joint, "axis", "xyz") or "1 0 0")),
        limits=_read_numbers(joint.find("limit")),
        soft_limits=_read_numbers(joint.find("safety_controller")),
        mimic=None
        if mimic is None
        else Mimic(
            _get_attribute(mimic, "joint"),
            float(mimic.get("multiplier", 1.0)),
            float(mimic.get("offset", 0.0)),
        ),
    )


def _read_origin(element: Element) -> Floats:
    """Return the pose (4, 4) of a joint or a collision geometry."""
    from scipy.spatial.transform import Rotation

    angles = parse_numbers(_read_attribute(element, "origin", "rpy") or "0 0 0")
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", angles).as_matrix()
    pose[:3, 3] = parse_numbers(_read_attribute(element, "origin", "xyz") or "0 0 0")
    return pose


def _read_numbers(element: Element | None) -> dict[str, float] | None:
    """Return the numbers of an element by attribute, or None without the element."""
    if element is None:
        return None
    names = _NUMBERS_PER_ATTRIBUTE[element.tag].keys() & element.keys()
    return {name: float(element.attrib[name]) for name in names}


def name_description(source: object) -> str:
    """Return the file of a URDF or SRDF, or a name for a text."""
    if not isinstance(source, str | os.PathLike):
        rule = "it must be a file name, or the text of the file"
        is_loaded = hasattr(source, "write_xml_string")  # by yourdfpy
        hint = "use path.write_xml_string().decode()" if is_loaded else ""
        raise InputError("path", f"is a {type(source).__name__}", rule, hint)
    text = str(source)
    return "robot_description" if text.lstrip().startswith("<") else text


def _read_robot(source: StrPath, kind: str) -> Element:
    """Return the root of a URDF or SRDF, a file or a text.

    Raises ContentError if it is no expanded robot.
    """
    name = name_description(source)
    is_file = name == str(source)
    root = read_xml(source, kind) if is_file else read_xml(name, kind, str(source))
    with decoding(name, kind):
        if root.tag != "robot":
            problem = f"holds <{root.tag:.60}>, not <robot>"
            hint = _BRING_YOUR_FILE if root.tag in ("sdf", "mujoco") else ""
            raise ContentError(problem, f"{kind} files describe a robot", hint)
        _check_expanded(root)
        return root


def _choose_geometry(root: Element, visuals: bool) -> None:
    """Leave out visual geometry.

    With ``visuals``, it becomes the collision geometry of links that have none.
    """
    for link in root.findall("link"):
        is_solid = link.find("collision") is not None
        for visual in link.findall("visual"):
            if visuals and not is_solid:
                visual.tag = "collision"
            else:
                visual.clear()


def _shorten_mimic_chains(joints: Mapping[str, JointDescription]) -> dict[str, JointDescription]:
    """Return joints that each mimic a joint which mimics no other.

    Raises ContentError if joints mimic each other in a loop.
    """
    mimics = {
        name: joint.mimic
        for name, joint in joints.items()
        if joint.mimic is not None and joint.type in _MOVING_TYPES
    }
    try:
        order = list(
            TopologicalSorter({k: [each.leader] for k, each in mimics.items()}).static_order()
        )
    except CycleError as error:
        _, (name, *_) = error.args  # the message, and the joints of the loop
        problem = f"has the joint {name!r}, which mimics itself"
        raise ContentError(problem, "it must mimic another joint") from error
    for name in order:  # leaders come first
        mimic = mimics.get(name)
        above = mimics.get(mimic.leader) if mimic is not None else None
        if mimic is not None and above is not None:
            mimics[name] = Mimic(
                above.leader,
                mimic.factor * above.factor,
                mimic.factor * above.offset + mimic.offset,
            )
    return {
        name: each._replace(mimic=mimics.get(name, each.mimic)) for name, each in joints.items()
    }


def warn_of_visuals(
    urdf: RobotDescription, links: Iterable[str], path: str | os.PathLike[str]
) -> None:
    """Warn of links with visual but without collision geometry."""
    names = [
        name for name in links if urdf.links[name].is_drawn and not urdf.links[name].collisions
    ]
    if names:
        warn_user(
            f"{os.fspath(path)}: <visual> but no <collision> at {', '.join(names)}; no proof "
            "covers what is only drawn; pass visuals=True to use <visual> there"
        )


def find_meshes(
    urdf: RobotDescription,
    links: Iterable[str],
    path: str | os.PathLike[str],
    package_dirs: Sequence[Path],
) -> dict[str, Path]:
    """Find the mesh files of links, by name.

    The files are not read. The search order is documented at :meth:`cspace.Robot.from_urdf`. One
    warning lists the files that have only a part of the names.

    Raises FileError if a mesh is missing or ambiguous.
    """
    places: dict[str, str] = {}
    for link in links:
        for number, collision in enumerate(urdf.links[link].collisions):
            if collision.kind == "mesh":
                places.setdefault(collision.file, f"link {link!r}, collision {number}")
    return locate_meshes(places, path, package_dirs)


def locate_meshes(
    places: Mapping[str, str], path: str | os.PathLike[str], package_dirs: Sequence[Path]
) -> dict[str, Path]:
    """Find the mesh files that a file names.

    See :func:`find_meshes` for the search. ``places`` has, for each mesh, its place in the file,
    for messages.
    """
    # Files under a mesh's full name come first; then a single file with the rest of its name.
    folder = Path(path).resolve().parent
    search = _MeshSearch(folder, package_dirs)
    meshes: dict[str, Path] = {}
    guesses: dict[str, Path] = {}
    for name, place in places.items():
        file = next(_find_existing(search.list_exact(name)), None)
        if file is None:
            files = list(_find_existing(search.list_guesses(name)))
            _check_single(files, f"{os.fspath(path)}: {place}: mesh {name}", folder)
            file = guesses[name] = files[0]
        meshes[name] = file
    # Largest number of meshes that a warning names.
    max_listed_meshes = 3
    if guesses:
        listed = [f"{name} from {file}" for name, file in guesses.items()]
        shown = ", ".join(listed[:max_listed_meshes])
        if len(listed) > max_listed_meshes:
            shown += f" and {len(listed) - max_listed_meshes} more"
        warn_user(
            f"{os.fspath(path)}: meshes are missing under their full names; the only file with "
            f"the rest of the name is read instead: {shown}"
        )
    return meshes


def _open_elements(root: Element, formats: Fields, parts: Mapping[str, str]) -> Ledger:
    """Return the ledger of an XML document's elements.

    ``parts`` has the attributes and children, separated by blanks, of each known element.
    """
    document = Ledger({}, root.tag, formats)
    pending = [root]
    while pending:
        element = pending.pop()
        tag = str(element.tag)
        children = {str(child.tag): child for child in element}
        ledger = document.inner({**element.attrib, **children}, f"<{tag}>", tag)
        ledger.taken.update(parts[tag].split())
        pending += [child for child in element if child.tag in ledger.taken & parts.keys()]
    return document


_XACRO_NAMESPACES: Final = ("{http://www.ros.org/wiki/xacro}", "{http://ros.org/wiki/xacro}")
"""Namespaces of xacro's elements. A file that xacro expanded may still declare one."""


def _check_expanded(root: Element) -> None:
    """Raise ContentError if a file holds unexpanded xacro macros or expressions."""
    tags = [str(element.tag) for element in root.iter()]
    values = [value for element in root.iter() for value in element.attrib.values()]
    has_expressions = any("${" in value or "$(" in value for value in values)
    if has_expressions or any(tag.startswith(_XACRO_NAMESPACES) for tag in tags):
        raise ContentError("holds xacro macros", "they must be expanded", _BRING_YOUR_FILE)


def _check_robot(root: Element) -> _Places:
    """Refuse malformed links and joints; return their angles and speeds.

    Raises ContentError.
    """
    noted: _Places = []
    names = _read_names(root, "link")
    if not names:
        raise ContentError("has no <link>", "a robot needs one")
    for kind in ("link", "joint"):
        check_distinct(_read_names(root, kind), f" as a {kind}")
        for element in root.findall(kind):
            noted += _check_numbers(element, f"{kind} {element.get('name')!r}")
    _check_tree(names, _find_parents(root, set(names)))
    for link in root.findall("link"):
        for number, collision in enumerate(link.findall("collision")):
            place = f"link {link.get('name')!r}, collision {number}"
            _check_geometry(collision.find("geometry"), place)
    return noted


def _check_single_parts(root: Element) -> None:
    """Raise ContentError for a repeated single part."""
    for element in itertools.chain(*map(root.iterfind, ("link", "link/collision", "joint"))):
        counts = Counter(str(child.tag) for child in element)
        for tag in _SINGLE_PARTS:
            if counts[tag] > 1:
                problem = f"has {counts[tag]} <{tag}> in a <{element.tag}>"
                raise ContentError(problem, "only one would be read")


def _read_names(root: Element, kind: str) -> list[str]:
    """Return the names of the links or joints of a robot."""
    return [str(element.get("name")) for element in root.findall(kind)]


def _find_parents(root: Element, links: set[str]) -> dict[str, str]:
    """Return the parent of each link but the roots.

    Refuses joints of unknown links or without an axis, and links with two parents.
    """
    parents: dict[str, str] = {}
    for joint in root.findall("joint"):
        name = joint.get("name")
        parent = _read_attribute(joint, "parent", "link")
        child = _read_attribute(joint, "child", "link")
        if parent not in links or child not in links:
            raise ContentError(
                f"joins {parent!r} to {child!r} by the joint {name!r}",
                "both must be links of the robot",
            )
        axis = _read_attribute(joint, "axis", "xyz") or "1 0 0"
        length = np.linalg.norm([float(word) for word in axis.split()])
        if joint.get("type") != "fixed" and length == 0.0:
            raise ContentError(
                f"has the axis {axis!r} at the joint {name!r}", "it must not be zero"
            )
        if child in parents:
            raise ContentError(
                f"joins {child!r} to {parents[child]!r} and {parent!r}",
                "a link has one parent",
            )
        parents[child] = parent
    return parents


def _read_attribute(element: Element, tag: str, name: str) -> str | None:
    """Return an attribute of a part of an element, or None."""
    child = element.find(tag)
    return None if child is None else child.get(name)


def _check_tree(names: list[str], parents: dict[str, str]) -> None:
    """Refuse links with a loop or several roots."""
    try:
        TopologicalSorter({child: [parent] for child, parent in parents.items()}).prepare()
    except CycleError as error:
        _, (link, *_) = error.args  # the message, and the links of the loop
        problem = f"joins {link!r} in a loop of joints"
        raise ContentError(problem, "links must form a tree") from error
    roots = [name for name in names if name not in parents]
    if len(roots) != 1:
        problem = f"has these links without a parent: {', '.join(roots)}"
        raise ContentError(problem, "there must be one root")


def _check_numbers(element: Element, place: str) -> _Places:
    """Refuse attributes of wrong counts; return angles and speeds.

    Raises ContentError. ``place`` names the element in messages.
    """
    angle_names = _ANGLES_PER_TYPE.get(element.get("type", ""), ("rpy",))
    angles = []
    # The element and all elements in it.
    for member in element.iter():
        if member.tag == "origin" and not member.attrib.keys() <= {"xyz", "rpy"}:
            problem = f"has an origin with {', '.join(member.attrib)} at {place}"
            raise ContentError(problem, "only xyz and rpy are read")
        for name, count in _NUMBERS_PER_ATTRIBUTE.get(str(member.tag), {}).items():
            text = member.get(name)
            if text is None:
                continue
            numbers = parse_numbers(text)
            attribute = f"{name}={text!r} at the {member.tag} of {place}"
            is_scalar = name == "scale" and len(numbers) == 1
            if len(numbers) != count and not is_scalar:
                rule = "one finite number" if count == 1 else f"{count} finite numbers"
                raise ContentError(f"has {attribute}", f"it must be {rule}")
            if name in angle_names:
                where = f"{name} at the {member.tag} of {place}"
                unit = "rad/s" if name == "velocity" else "rad"
                angles.append((where, max(numbers, key=abs), unit))
    return angles


def _check_geometry(geometry: Element | None, place: str) -> None:
    """Refuse collision geometry other than one known shape.

    Raises ContentError. ``place`` names the geometry in messages.
    """
    # One child, with all attributes of its kind.
    shapes = [] if geometry is None else list(geometry)
    if len(shapes) != 1 or shapes[0].tag not in GEOMETRIES:
        kinds = ", ".join(f"<{shape.tag:.40}>" for shape in shapes) or "nothing"
        raise ContentError(
            f"has {kinds} as the geometry of {place}",
            f"it must be one of {', '.join(GEOMETRIES)}",
        )
    shape = shapes[0]
    for name in GEOMETRIES[shape.tag]:
        if name not in shape.attrib:
            problem = f"lacks the {name} of the {shape.tag} of {place}"
            raise ContentError(problem, "it must be there")


def root_link(urdf: RobotDescription) -> str:
    """Return the link without a parent."""
    children = {joint.child for joint in urdf.joints.values()}
    return next(name for name in urdf.links if name not in children)


def _list_child_joints(urdf: RobotDescription) -> dict[str, list[JointDescription]]:
    """List the joints that each link carries."""
    below: dict[str, list[JointDescription]] = {name: [] for name in urdf.links}
    for joint in urdf.joints.values():
        below[joint.parent].append(joint)
    return below


def fixed_links(urdf: RobotDescription) -> list[str]:
    """List the links that are fixed to the root.

    The root comes first.
    """
    rigid = [root_link(urdf)]
    below = _list_child_joints(urdf)
    for name in rigid:  # the list grows in the loop
        rigid += [joint.child for joint in below[name] if joint.type == "fixed"]
    return rigid


def zero_poses(urdf: RobotDescription) -> dict[str, Floats]:
    """Return the pose of each link at zero joints.

    Poses are matrices, shape (4, 4), relative to the root. A joint that mimics another one is at
    its offset.
    """
    root = root_link(urdf)
    below = _list_child_joints(urdf)
    poses = {root: np.eye(4)}
    order = [root]
    for name in order:  # the list grows in the loop
        for joint in below[name]:
            pose = poses[name] @ joint.frame
            # The joint that it mimics is at zero, so it moves by its offset.
            if joint.mimic is not None and joint.type in _MOVING_TYPES:
                displacement = joint.mimic.offset * joint.axis / np.linalg.norm(joint.axis)
                pose = pose @ make_motion(displacement, slides=joint.type == "prismatic")
            poses[joint.child] = pose
            order.append(joint.child)
    return poses


def make_motion(displacement: Floats, *, slides: bool) -> Floats:
    """Return the motion (4, 4) of a sliding or turning joint.

    ``displacement`` is its axis, shape (3,), times metres or radians.
    """
    from scipy.spatial.transform import Rotation

    motion = np.eye(4)
    if slides:
        motion[:3, 3] = displacement
    else:
        motion[:3, :3] = Rotation.from_rotvec(displacement).as_matrix()
    return motion


def package_folders(package_dirs: PackageDirs) -> list[Path]:
    """Return package folders as a list of paths.

    ``package_dirs`` is one folder or several.

    Raises InputError if it is of another type or a folder is missing.
    """
    if isinstance(package_dirs, str | os.PathLike):
        package_dirs = [package_dirs]
    try:
        folders = [Path(folder) for folder in package_dirs]
    except TypeError as error:
        raise InputError(
            "package_dirs",
            f"is {package_dirs!r}",
            "it must be a folder, or a list of folders",
        ) from error
    for folder in folders:
        if not os.path.isdir(folder):  # noqa: PTH112 - Path.is_dir raises OSError for some names
            raise InputError(
                "package_dirs",
                f"names {folder}",
                "each must be an existing folder that holds the folders of packages",
            )
    return folders


class _MeshSearch:
    """Candidate paths of meshes that a URDF in a folder names, in order of preference."""

    def __init__(self, folder: Path, package_dirs: Sequence[Path]) -> None:
        """Remember the folder of the URDF, and those of packages."""
        self._folder = folder
        self._near = [*package_dirs, folder, *folder.parents]
        self._roots = [*package_dirs, *_list_folders("ROS_PACKAGE_PATH")]

    def list_exact(self, name: str) -> Iterator[Path]:
        """Yield the paths for a mesh's full name."""
        relatives = _list_relatives(name)
        if not _has_package(name):
            yield from (self._folder / relative for relative in relatives)
            return
        bases = [*self._near, *self._roots]
        yield from (base / relative for base in bases for relative in relatives)
        for relative in relatives:
            package, _, rest = relative.partition("/")
            if package in self._packages:
                yield self._packages[package] / rest
        for prefix in _list_folders("AMENT_PREFIX_PATH"):
            yield from (prefix / "share" / relative for relative in relatives)

    def list_guesses(self, name: str) -> Iterator[Path]:
        """Yield paths for a part of a mesh's name."""
        for relative in _list_relatives(name):
            rest = relative.partition("/")[2] if _has_package(name) else relative
            yield from (base / rest for base in self._near)

    @cached_property
    def _packages(self) -> dict[str, Path]:
        """Folders of packages at any depth, by name, as ROS finds them.

        A package has no other packages in its folder.
        """
        packages: dict[str, Path] = {}
        seen = set[str]()
        for root in self._roots:
            for place, folders, files in os.walk(root, followlinks=True):
                real = os.path.realpath(place)
                if "package.xml" in files:
                    packages.setdefault(_read_package_name(Path(place)), Path(place))
                if real in seen or not _CRAWL_ENDS.isdisjoint(files):
                    folders.clear()
                seen.add(real)
                folders[:] = sorted(name for name in folders if not name.startswith("."))
        return packages


def _has_package(name: str) -> bool:
    """Return True if a mesh's name starts with that of a package."""
    return name.startswith(("package://", "model://"))


def _list_relatives(name: str) -> list[str]:
    """Return a mesh's name without its scheme, as it is and with %20 as a blank."""
    escaped = name.rpartition("://")[2]
    return list(dict.fromkeys([escaped, unquote(escaped)]))


def _read_package_name(folder: Path) -> str:
    """Return the name in a package's manifest, or that of its folder."""
    with suppress(FileError):
        return read_xml(folder / "package.xml", "package").findtext("name", folder.name).strip()
    return folder.name


def _list_folders(variable: str) -> list[Path]:
    """List the folders that an environment variable names."""
    names = os.environ.get(variable, "").split(os.pathsep)
    return [Path(name) for name in names if name]


def _find_existing(places: Iterable[Path]) -> Iterator[Path]:
    """Yield the paths that are files, without duplicates."""
    found = set[Path]()
    for place in places:
        with suppress(OSError):  # a name that no file can have
            if place.is_file() and place.resolve() not in found:
                found.add(place.resolve())
                yield place


def _check_single(files: Sequence[Path], place: str, folder: Path) -> None:
    """Raise FileError unless exactly one file matches a mesh."""
    # No file, or several without the full name.
    if not files:
        rule = (
            f"the search covers package_dirs, {folder} and the folders above it, "
            "ROS_PACKAGE_PATH and AMENT_PREFIX_PATH, and packages below the first and the third"
        )
        raise FileError(place, "does not exist", rule)
    if len(files) > 1:
        rule = f"several files match a part of it: {', '.join(map(str, files))}"
        raise FileError(place, "does not exist under its full name", rule)


_CRAWL_ENDS: Final = {
    *("package.xml", "manifest.xml"),
    *("AMENT_IGNORE", "CATKIN_IGNORE", "COLCON_IGNORE"),
}
"""Files of folders below which ROS searches for no package."""

_SRDF_KIND: Final = "SRDF"
"""Kind of file, for messages."""

_MOVING_TYPES: Final = ("revolute", "continuous", "prismatic")
"""Types of joints with one value."""


class Srdf(NamedTuple):
    """The content of an SRDF.

    Attributes
    ----------
    allowed : dict of (str, str) to str
        Reason for each pair of links that may touch; the links of a pair are in alphabetical order.
    never : set of (str, str)
        Alphabetical pairs that may touch because they never did, ``reason="Never"``.
    groups : dict of str to set of str
        Joints of each group.
    states : dict of str to dict of str to float
        Values of the revolute and prismatic joints, by ``GROUP/STATE``, or by ``STATE`` without a
        group. States without known joints are omitted.
    passive_joints : set of str
        Joints without a motor.
    """

    allowed: dict[tuple[str, str], str]
    never: set[tuple[str, str]]
    groups: dict[str, set[str]]
    states: dict[str, dict[str, float]]
    passive_joints: set[str]


def read_srdf(path: str | os.PathLike[str], urdf: RobotDescription) -> Srdf:
    """Read the SRDF of a robot.

    Elements that name unknown links or joints are skipped, and so are pairs with a link without
    collision geometry. One warning lists all skipped names.

    Raises FileError if the file is missing or malformed.
    """
    root, path = _read_robot(path, _SRDF_KIND), name_description(path)
    with decoding(path, _SRDF_KIND):
        if root.get("name", urdf.name) != urdf.name:
            warn_user(
                f"{os.fspath(path)}: describes the robot {root.get('name')!r:.60}, and the URDF "
                f"{urdf.name!r:.60}"
            )
        ledger = _open_elements(root, FIELDS[1], _SRDF_PARTS)
        reader = _Reader(root, urdf)
        srdf = Srdf(
            reader.read_allowed(),
            reader.never,
            reader.read_groups(),
            reader.read_states(),
            reader.read_passive_joints(),
        )
    ledger.noted = reader.angles
    ledger.close(os.fspath(path))
    # The reader has collected the names that it skipped.
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

    def __init__(self, root: Element, urdf: RobotDescription) -> None:
        """List the links and joints of the robot, virtual joints included."""
        self._root = root
        self._links = urdf.links
        self._joint_above = {joint.child: joint for joint in urdf.joints.values()}
        self._joint_types = {name: joint.type for name, joint in urdf.joints.items()}
        for joint in root.iter("virtual_joint"):
            self._joint_types[_get_attribute(joint, "name")] = "virtual"
        self.angles: _Places = []
        self.never: set[tuple[str, str]] = set()
        self.unknown: dict[str, None] = {}
        self.bare: dict[str, None] = {}

    def _check_known(self, names: Iterable[str], known: Container[str]) -> bool:
        """Return True if the URDF has all names; collect the others."""
        missing = [name for name in names if name not in known]
        self.unknown |= dict.fromkeys(missing)
        return not missing

    def read_allowed(self) -> dict[tuple[str, str], str]:
        """Return the pairs of links that may touch, each with its reason.

        Like MoveIt, apply the defaults first, then enabled, then disabled pairs. But collect in
        ``never`` the pairs that never touched where MoveIt's assistant sampled, which proves
        nothing.
        """
        # A dict instead of a set keeps the order of the links.
        solid = {name: None for name, link in self._links.items() if link.collisions}
        allowed: dict[tuple[str, str], str] = {}
        for (name,), reason in self._iterate_links("disable_default_collisions", "link"):
            if name in solid:
                partners = (link for link in solid if link != name)
                allowed |= {_sort_pair(name, partner): reason for partner in partners}
        for names, _ in self._iterate_links("enable_collisions", "link1", "link2"):
            allowed.pop(_sort_pair(*names), None)
        for names, reason in self._iterate_links("disable_collisions", "link1", "link2"):
            bare = [name for name in names if name not in solid]
            self.bare |= dict.fromkeys(bare)
            if bare:
                continue
            pair = _sort_pair(*names)
            if reason.casefold() == "never":
                self.never.add(pair)
            else:
                allowed[pair] = reason
        self.never -= allowed.keys()
        return allowed

    def _iterate_links(self, tag: str, *keys: str) -> Iterator[tuple[tuple[str, ...], str]]:
        """Yield links and reason of each element with known links."""
        for element in self._root.iter(tag):
            names = tuple(_get_attribute(element, key) for key in keys)
            if self._check_known(names, self._links):
                yield names, element.get("reason") or _SRDF_KIND

    def read_groups(self) -> dict[str, set[str]]:
        """Return the joints of each group."""
        groups = {_get_attribute(group, "name"): group for group in self._root.findall("group")}
        inner = {
            name: [_get_attribute(member, "name") for member in group.findall("group")]
            for name, group in groups.items()
        }
        joints: dict[str, set[str]] = {}
        try:
            for name in TopologicalSorter(inner).static_order():  # inner groups come first
                if name in groups:
                    joints[name] = self._collect_joints(groups[name], joints)
        except CycleError as error:
            _, (name, *_) = error.args  # the message, and the groups of the loop
            problem = f"has the group {name!r} within itself"
            raise ContentError(problem, "subgroups must end") from error
        return {name: joints[name] for name in groups}

    def _collect_joints(self, group: Element, inner: Mapping[str, set[str]]) -> set[str]:
        """Return the joints of a group, given those of its ``inner`` groups."""
        joints: set[str] = set()
        for member in group:
            if member.tag == "chain":
                base = _get_attribute(member, "base_link")
                tip = _get_attribute(member, "tip_link")
                if self._check_known([base, tip], self._links):
                    # Joints above both ends are not between them.
                    joints |= self._list_joints_above(base) ^ self._list_joints_above(tip)
                continue
            known_names: dict[str, Container[str]] = {
                "joint": self._joint_types,
                "link": self._links,
                "group": inner,
            }
            if member.tag not in known_names:
                continue
            member_name = _get_attribute(member, "name")
            if not self._check_known([member_name], known_names[member.tag]):
                continue
            if member.tag == "joint":
                joints.add(member_name)
            elif member.tag == "group":
                joints |= inner[member_name]
            elif member_name in self._joint_above:  # a link stands for the joint above it
                joints.add(self._joint_above[member_name].name)
        return joints

    def _list_joints_above(self, link: str) -> set[str]:
        """Return the joints between a link and the root."""
        joints = set()
        while link in self._joint_above:
            joint = self._joint_above[link]
            joints.add(joint.name)
            link = joint.parent
        return joints

    def read_passive_joints(self) -> set[str]:
        """Return the joints without a motor."""
        joints = self._root.findall("passive_joint")
        names = {_get_attribute(joint, "name") for joint in joints}
        self._check_known(names, self._joint_types)
        return names

    def read_states(self) -> dict[str, dict[str, float]]:
        """Return the named states, without unknown joints."""
        states = {}
        for state in self._root.findall("group_state"):
            name = "/".join(filter(None, (state.get("group"), _get_attribute(state, "name"))))
            # Texts by joint. Skip a state that no joint of the robot takes part in.
            values = {
                _get_attribute(joint, "name"): _get_attribute(joint, "value")
                for joint in state.findall("joint")
            }
            self._check_known(values, self._joint_types)
            if values and values.keys().isdisjoint(self._joint_types):
                continue
            if name in states:
                problem = f"has the state {name!r} twice"
                raise ContentError(problem, "only the last would count")
            moving = [joint for joint in values if self._joint_types.get(joint) in _MOVING_TYPES]
            states[name] = {joint: _parse_value(values[joint], name, joint) for joint in moving}
            for joint, value in states[name].items():
                if self._joint_types[joint] != "prismatic":
                    self.angles.append((f"{joint} of the state {name!r}", value, "rad"))
        return states


def _parse_value(text: str, state: str, joint: str) -> float:
    """Parse a joint's value in a named state.

    Raises ContentError if it is not a finite number.
    """
    numbers = parse_numbers(text)
    if len(numbers) != 1:
        raise ContentError(
            f"has {joint} at {text!r} in the state {state!r}",
            "it must be one finite number",
        )
    return numbers[0]


def _get_attribute(element: Element, key: str) -> str:
    """Return a required attribute of an XML element.

    Raises ContentError if it is missing.
    """
    value = element.get(key)
    if value is None:
        raise ContentError(f"has a <{element.tag}> without {key}", "it must be there")
    return value


def _sort_pair(first: str, second: str) -> tuple[str, str]:
    """Return two names in alphabetical order."""
    return (first, second) if first < second else (second, first)
