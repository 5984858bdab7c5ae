"""Shapes of URDF links and of obstacles in MoveIt planning scenes.

Scenes are YAML, as ROS prints the message or as MotionBenchMaker writes it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cspace.arrays import Floats, StrPath, Surface
from cspace.check import (
    check_finite,
    check_known,
    check_names,
    check_point,
    check_positive,
)
from cspace.errors import GeometryError, InputError, warn_user
from cspace.files.access import ContentError, decoding
from cspace.files.meshes import read_mesh
from cspace.files.moveit import (
    WORLD,
    check_identity,
    check_list,
    check_table,
    parse_flag,
    parse_frame,
    parse_name,
    parse_names,
    parse_numbers,
    parse_pose,
    refuse_link_values,
)
from cspace.files.plain import read_yaml
from cspace.files.polygons import join_surfaces, surface_bytes, transform_surface
from cspace.files.urdf import (
    GEOMETRIES,
    PackageDirs,
    find_meshes,
    fixed_links,
    load_urdf,
    locate_meshes,
    package_folders,
    zero_poses,
)
from cspace.limits import check_file_memory
from cspace.shapes.balls import Balls
from cspace.shapes.mesh import Mesh, Solid
from cspace.shapes.shape import (
    BoundedShape,
    BoundsPair,
    ExactShape,
    Shape,
    capsule_bounds,
    cone_bounds,
    cylinder_bounds,
)
from cspace.shapes.voxels import Box

if TYPE_CHECKING:
    from yourdfpy import URDF


def read_urdf(
    path: str | os.PathLike[str],
    link: str | Sequence[str] | None = None,
    package_dirs: PackageDirs = (),
    primitives: bool = True,
) -> list[Surface]:
    """Read the surface of a robot's collision geometry, metres.

    It is in the frame of the first link. Links are as for :meth:`cspace.Robot.from_urdf`. If a
    shape is curved, return an outer and an inner surface. Without `primitives`, only meshes are
    accepted.

    Raises FileError if the file or a mesh is missing or malformed. Raises InputError if a link is
    missing, the links have no collision geometry, or a size is not above zero. Raises
    MissingPackageError without yourdfpy.
    """
    folders = package_folders(package_dirs)
    file = os.fspath(path)
    urdf = load_urdf(path)
    links = fixed_links(urdf) if link is None else check_names(link, "link")
    for name in links:
        check_known(name, "link", urdf.link_map)
    pairs, meshes, poses = [], find_meshes(urdf, links, path, folders), zero_poses(urdf)
    for name in links:
        pose: Floats = np.linalg.solve(poses[links[0]], poses[name]).astype(np.float64)
        for number, collision in enumerate(urdf.link_map[name].collisions):
            place = f"{file}: link {name!r}, collision {number}"
            if not primitives and collision.geometry.mesh is None:
                problem = (
                    f"is 'surface', and {place} is a box, a cylinder or a sphere, which is solid"
                )
                rule = "only a mesh can be a surface without an inside"
                hint = "omit it, or name links with only meshes"
                raise InputError("solid", problem, rule, hint, value="surface")
            transform = pose @ _read_origin(collision, place)
            outer, inner = _bounds_pair(collision.geometry, meshes, place)
            moved = transform_surface(outer, transform)
            pairs.append((moved, moved if inner is outer else transform_surface(inner, transform)))
    _check_shapes(urdf, link, links, file)
    curved = any(outer is not inner for outer, inner in pairs)
    return [join_surfaces(side) for side in list(zip(*pairs, strict=True))[: 1 + curved]]


def _check_shapes(
    urdf: URDF, given: str | Sequence[str] | None, links: Sequence[str], file: str
) -> None:
    """Refuse links without collision geometry, and warn if links that move are left out."""
    filled = [name for name in urdf.link_map if urdf.link_map[name].collisions]
    left = [name for name in filled if name not in links]
    if len(left) == len(filled):
        hint = f"name links that have: {', '.join(filled)}" if filled else "add <collision>"
        problem, rule = f"is {', '.join(links) or 'empty'}", "no such link has collision geometry"
        raise InputError("link", problem, rule, hint, value=given)
    if given is None and left:
        warn_user(
            f"{file}: {', '.join(left)} move against {links[0]} and are omitted; to include them, "
            "name all links, which are placed with their joints at zero"
        )


def _read_origin(collision: Any, place: str) -> Floats:
    """Return the pose of a collision geometry in the frame of its link, shape (4, 4)."""
    if collision.origin is None:
        return np.eye(4)
    return check_finite(collision.origin, f"{place}: origin")


def link_shapes(
    urdf: URDF, link: str, path: str | os.PathLike[str], meshes: Mapping[str, Path], solid: Solid
) -> Iterator[tuple[Shape, Floats]]:
    """Yield the shapes of a link and their poses.

    Poses are in the frame of the link, shape (4, 4). `meshes` are the files from
    :func:`find_meshes`; `solid` says which part of a mesh is solid.

    Raises FileError if a mesh is malformed, and InputError if a size is not above zero.
    """
    for number, collision in enumerate(urdf.link_map[link].collisions):
        place = f"{os.fspath(path)}: link {link!r}, collision {number}"
        surface, within = _bounds_pair(collision.geometry, meshes, place)
        outer = Mesh(*surface, solid if collision.geometry.mesh is not None else "auto", place)
        outer.warn_if_open(fills=False)
        shape = outer if within is surface else BoundedShape(outer, Mesh.of(within))
        yield shape, _read_origin(collision, place)


def _bounds_pair(geometry: Any, meshes: Mapping[str, Path], place: str) -> BoundsPair:
    """Return an outer and an inner surface of a geometry.

    They are the same object if it is not curved.
    """
    kind = next(name for name in GEOMETRIES if getattr(geometry, name) is not None)
    return _SURFACE_MAKERS[kind](getattr(geometry, kind), meshes, f"{place}: {kind}")


def _make_box_bounds(box: Any, meshes: Mapping[str, Path], place: str) -> BoundsPair:
    """Return the surface of a box of a URDF, twice."""
    sides = check_point(box.size, f"{place}: size", 3).tolist()
    surface = Box.of([check_positive(side, f"{place}: size") for side in sides]).surface
    return surface, surface


def _make_mesh_bounds(mesh: Any, meshes: Mapping[str, Path], place: str) -> BoundsPair:
    """Return the surface of a mesh of a URDF, twice."""
    scale = check_finite(
        np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3), f"{place}: scale"
    )
    if not scale.all():
        problem, rule = f"is {scale.tolist()}", "no factor may be zero"
        raise InputError(f"{place}: scale", problem, rule, "correct it", value=scale)
    surface = transform_surface(read_mesh(meshes[str(mesh.filename)]), np.diag([*scale, 1.0]))
    return surface, surface


def _make_curved_bounds(
    make: Callable[..., BoundsPair],
    names: Sequence[str],
    shape: Any,
    meshes: Mapping[str, Path],
    place: str,
) -> BoundsPair:
    """Make the outer and the inner surface of a curved shape of a URDF.

    ``make`` takes the sizes that ``shape`` has under ``names``. ``meshes`` is unused: makers share
    one signature.
    """
    sizes = (check_positive(getattr(shape, name), f"{place}: {name}") for name in names)
    return make(*sizes)


_SURFACE_MAKERS: Final[Mapping[str, Callable[[Any, Mapping[str, Path], str], BoundsPair]]] = {
    "box": _make_box_bounds,
    "cylinder": partial(_make_curved_bounds, cylinder_bounds, ("radius", "length")),
    "sphere": partial(_make_curved_bounds, partial(capsule_bounds, length=0.0), ("radius",)),
    "mesh": _make_mesh_bounds,
}
"""Function that makes the outer and inner surface of each kind of URDF geometry."""


SCENE_KIND: Final = "planning scene"
"""Kind of file, for messages."""

MAX_SHAPES: Final = 10_000
"""Maximum number of shapes in one scene."""

_OPERATIONS: Final = (None, "", "add", 0, "\0")
"""Ways to write that an object is added: not at all, as a word, a number, or the byte that ROS 2
prints."""

_POSE_LISTS: Final = {"primitives": "primitive_poses", "meshes": "mesh_poses"}
"""For each list of shapes in a collision object, the list of their poses."""

_REFUSED_FIELDS: Final = {
    "planes": ("a plane has no end", "write a box"),
    "plane_poses": ("a plane has no end", "write a box"),
    "subframe_names": (
        "frames of objects are not read",
        "remove them, and write poses in the planning frame",
    ),
    "subframe_poses": (
        "frames of objects are not read",
        "remove them, and write poses in the planning frame",
    ),
}
"""Fields of a collision object that must be empty: the rule, and the hint."""


class SceneShape(NamedTuple):
    """A shape of a planning scene.

    Attributes
    ----------
    name : str
        Id of its collision object, with ``/0``, ``/1`` and so on if that holds several shapes.
    shape : Shape
    pose : ndarray of float64, shape (4, 4)
        Motion from the frame of the shape to the frame of its object.
    object_id : str
        Id of its collision object.
    """

    name: str
    shape: Shape
    pose: Floats
    object_id: str


class AttachedShapes(NamedTuple):
    """The shapes of an object that a link carries.

    Attributes
    ----------
    link : str
    frame : str
        Frame of the poses: the link, or the planning frame.
    touch_links : list of str
        Further links that may touch it.
    shapes : list of SceneShape
    """

    link: str
    frame: str
    touch_links: list[str]
    shapes: list[SceneShape]


class SceneContent(NamedTuple):
    """Content of a planning scene.

    Attributes
    ----------
    frame : str
        The planning frame.
    shapes : list of SceneShape
        Obstacles, in the planning frame.
    attached : list of AttachedShapes
        Objects that the robot carries.
    table : mapping
        The message itself.
    """

    frame: str
    shapes: list[SceneShape]
    attached: list[AttachedShapes]
    table: Mapping[str, Any]


_SCENE_FIELDS: Final = (
    *(
        "name",
        "robot_state",
        "robot_model_name",
        "fixed_frame_transforms",
        "allowed_collision_matrix",
    ),
    *("link_padding", "link_scale", "object_colors", "world", "is_diff"),
)
"""Fields of a moveit_msgs/PlanningScene."""

_OBJECT_FIELDS: Final = (
    *("header", "pose", "id", "type", "operation", *_REFUSED_FIELDS),
    *(field for pair in _POSE_LISTS.items() for field in pair),
)
"""Fields of a moveit_msgs/CollisionObject."""


def read_scene_shapes(path: StrPath, package_dirs: PackageDirs = ()) -> list[Shape]:
    """Read the obstacles of a planning scene, in its planning frame.

    A warning lists the attached objects, which are not read. Raises as :func:`read_scene`, and
    GeometryError if the scene has no shape.
    """
    scene = read_scene(path, package_dirs)
    if not scene.shapes:
        raise GeometryError(
            os.fspath(path), "holds no shape", "a scene needs one", "pass another file"
        )
    if scene.attached:
        listed = ", ".join(each.shapes[0].object_id for each in scene.attached)
        warn_user(
            f"{os.fspath(path)}: attached objects ({listed}) enlarge the robot and are not read; "
            "use arm.attach"
        )
    return [_transform(each.shape, each.pose) for each in scene.shapes]


def read_scene(path: StrPath, package_dirs: PackageDirs = ()) -> SceneContent:
    """Read the shapes of a planning scene.

    Parameters
    ----------
    path : path-like
        YAML of a ``moveit_msgs/PlanningScene``, or of its ``world``.
    package_dirs : path-like, or sequence of path-like
        Folders that hold the folders of packages, for meshes.

    Raises FileError if the file is missing or malformed, holds anything but boxes, spheres,
    cylinders, cones and meshes in one frame, or only changes another scene. Raises GeometryError if
    a mesh has no triangle.
    """
    folders = package_folders(package_dirs)
    content = read_yaml(path, SCENE_KIND)
    with decoding(path, SCENE_KIND):
        scene = check_table(content, "the file")
        is_world = "world" not in scene and "collision_objects" in scene
        scene = {"world": scene} if is_world else check_table(scene, "the scene", _SCENE_FIELDS)
        if parse_flag(scene.get("is_diff"), "is_diff"):
            raise ContentError(
                "has is_diff: true", "it only changes another scene", "write the whole scene"
            )
        world = check_table(scene.get("world"), "world", ("collision_objects", "octomap"))
        state = check_table(scene.get("robot_state"), "robot_state")
        attached = check_list(state.get("attached_collision_objects"), "attached_collision_objects")
        if "collision_objects" not in world and not attached:
            rule = "a planning scene lists its obstacles there"
            raise ContentError(
                "has no world.collision_objects",
                rule,
                "pass the YAML of a moveit_msgs/PlanningScene",
            )
        _refuse_rest(scene, world)
        reader = _Reader(path, folders)
        objects = check_list(world.get("collision_objects"), "collision_objects")
        frames, shapes = set[str](), list[SceneShape]()
        for number, item in enumerate(objects):
            frame, parts = reader.read_object(item, f"collision_objects[{number}]")
            frames.add(frame)
            shapes += parts
        carried = [
            reader.read_attached(item, f"attached_collision_objects[{k}]")
            for k, item in enumerate(attached)
        ]
        frames |= {each.frame for each in carried if each.frame != each.link}
        every = [*shapes, *(shape for each in carried for shape in each.shapes)]
        parse_names([shape.name for shape in every], "the names of shapes")
        return SceneContent(
            _find_frame(frames, {shape.object_id for shape in every}), shapes, carried, scene
        )


def _refuse_rest(scene: Mapping[str, Any], world: Mapping[str, Any]) -> None:
    """Raise ContentError if a scene holds an OctoMap, transforms, or links of another size."""
    octomap = check_table(world.get("octomap"), "octomap", ("header", "origin", "octomap"))
    tree = check_table(
        octomap.get("octomap"), "octomap", ("header", "binary", "id", "resolution", "data")
    )
    parse_pose(octomap.get("origin"), "origin of octomap")
    for entry in (octomap, tree):
        parse_frame(entry, "octomap")
    if tree.get("data"):
        hint = "save it as .bt, read it with Workspace.from_octomap, and remove it here"
        raise ContentError("holds an OctoMap", "only collision objects are read", hint)
    for number, item in enumerate(
        check_list(scene.get("fixed_frame_transforms"), "fixed_frame_transforms")
    ):
        place = f"fixed_frame_transforms[{number}]"
        entry = check_table(item, place, ("header", "child_frame_id", "transform"))
        parse_frame(entry, place)
        hint = "write the objects in the planning frame, e.g. by tf2, and remove the transform"
        check_identity(
            entry.get("transform"), f"transform of {place}", "frames are not transformed", hint
        )
    hint = "remove link_padding, and pass padding= to build_arm_space"
    refuse_link_values(scene.get("link_padding"), "link_padding", "padding", 0.0, hint)
    hint = "remove link_scale, and pass padding= to build_arm_space"
    refuse_link_values(scene.get("link_scale"), "link_scale", "scale", 1.0, hint)


def _find_frame(frames: Set[str], object_ids: Set[str]) -> str:
    """Return the one frame of all objects."""
    hint = (
        "write them in the planning frame; objects may be in the frame of the link that carries "
        "them"
    )
    if len(frames) > 1:
        problem = f"has objects in the frames {', '.join(map(repr, sorted(frames)))}"
        raise ContentError(problem, "they must be in one frame", hint)
    frame = next(iter(frames), WORLD)
    if frame in object_ids:
        raise ContentError(
            f"has poses in the frame {frame!r} of an object", "it is not the planning frame", hint
        )
    return frame


class _Reader:
    """Maker of the shapes of collision objects."""

    def __init__(self, path: StrPath, folders: Sequence[Path]) -> None:
        self._path, self._folders = path, folders
        self._meshes: dict[str, Surface] = {}
        self._ids: set[str] = set()
        self._count, self._bytes = 0, 0

    def read_object(self, item: Any, place: str) -> tuple[str, list[SceneShape]]:
        """Return the frame and the shapes of a collision object."""
        entry = check_table(item, place, _OBJECT_FIELDS)
        given = entry.get("id")
        name = (
            str(given) if type(given) is int else parse_name(given, f"id of {place}")
        )  # robowflex omits quotes
        if name in self._ids:
            problem = f"has the object {name!r} again at {place}"
            raise ContentError(problem, "ids must differ", "rename or remove one")
        self._ids.add(name)
        place = f"object {name!r}"
        operation = entry.get("operation")
        operation = operation.lower() if isinstance(operation, str) else operation
        if type(operation) not in (type(None), str, int) or operation not in _OPERATIONS:
            problem = f"has the operation {entry['operation']!r} at {place}"
            raise ContentError(problem, "it must be add (0)", "write the scene as it is")
        for field, (rule, hint) in _REFUSED_FIELDS.items():
            if entry.get(field):
                raise ContentError(f"has {field} at {place}", rule, hint)
        shapes = list(self._read_shapes(entry, place))
        if not shapes:
            rule = "it must have primitives or meshes"
            raise ContentError(f"has no shape at {place}", rule, "add them, or remove the object")
        names = (
            [name] if len(shapes) == 1 else [f"{name}/{number}" for number in range(len(shapes))]
        )
        parts = [SceneShape(part, *each, name) for part, each in zip(names, shapes, strict=True)]
        return parse_frame(entry, place), parts

    def read_attached(self, item: Any, place: str) -> AttachedShapes:
        """Return the shapes of an attached object."""
        carried = check_table(
            item, place, ("link_name", "object", "touch_links", "detach_posture", "weight")
        )
        link = parse_name(carried.get("link_name"), f"link_name of {place}")
        entry = check_table(carried.get("object"), f"the object of {place}")
        if not check_table(entry.get("header"), f"the header of {place}").get("frame_id"):
            rule = "MoveIt and robowflex would take the frame of the world"
            raise ContentError(f"has no header.frame_id at {place}", rule, f"add it, e.g. {link}")
        frame, shapes = self.read_object(entry, f"the object of {place}")
        touch_links = parse_names(carried.get("touch_links"), f"touch_links of {place}")
        return AttachedShapes(link, frame, touch_links, shapes)

    def _read_shapes(self, entry: Mapping[str, Any], place: str) -> Iterator[tuple[Shape, Floats]]:
        """Yield the shapes of an object, with their poses."""
        whole = parse_pose(entry.get("pose"), f"the pose of {place}")
        makers = {"primitives": self._read_primitive, "meshes": self._read_mesh}
        for name, poses_name in _POSE_LISTS.items():
            items = check_list(entry.get(name), f"{name} of {place}")
            poses = check_list(entry.get(poses_name), f"{poses_name} of {place}")
            if len(poses) != len(items) and (poses or len(items) > 1):
                problem = f"has {len(items)} {name} but {len(poses)} {poses_name} at {place}"
                raise ContentError(problem, "each needs a pose", "add or remove some")
            for number, item in enumerate(items):
                self._count += 1
                if self._count > MAX_SHAPES:
                    problem = f"holds more than {MAX_SHAPES} shapes"
                    raise ContentError(problem, "the rest is not read", "split the scene")
                pose = parse_pose(
                    poses[number] if poses else None, f"{poses_name}[{number}] of {place}"
                )
                yield makers[name](item, f"{name}[{number}] of {place}"), whole @ pose

    def _read_primitive(self, item: Any, place: str) -> Shape:
        """Return a primitive as a shape."""
        kind, sizes = parse_primitive(item, place)
        return _PRIMITIVES[kind][2](*sizes)

    def _read_mesh(self, item: Any, place: str) -> Shape:
        """Return a mesh as a shape."""
        table = check_table(item, place, ("triangles", "vertices", "resource", "dimensions"))
        if table.get("resource") and (table.get("vertices") or table.get("triangles")):
            raise ContentError(
                f"has a resource and vertices at {place}", "a mesh has one of them", "remove one"
            )
        if table.get("dimensions") is not None and not table.get("resource"):
            rule = "they scale the mesh of a file"
            raise ContentError(f"has dimensions without resource at {place}", rule, "remove them")
        if table.get("resource"):
            vertices, faces = self._read_mesh_file(table, place)
        else:
            vertices, faces = _parse_inline_mesh(table, place)
        self._bytes += surface_bytes(len(vertices), len(faces))
        check_file_memory(self._path, "holds meshes", self._bytes)
        return Mesh(vertices, faces, source=f"{os.fspath(self._path)}: {place}")

    def _read_mesh_file(self, table: Mapping[str, Any], place: str) -> Surface:
        """Return the surface of a mesh in another file."""
        name = str(table["resource"])
        if name not in self._meshes:
            file = locate_meshes({name: place}, self._path, self._folders)[name]
            self._meshes[name] = read_mesh(file)
        scale = np.ones(3)
        if table.get("dimensions") is not None:
            scale = parse_numbers(table["dimensions"], 3, f"dimensions of {place}")
        if not scale.all():
            problem = f"has the dimensions {scale.tolist()} at {place}"
            raise ContentError(problem, "no factor may be zero", "correct them")
        return transform_surface(self._meshes[name], np.diag([*scale, 1.0]))


def _parse_inline_mesh(table: Mapping[str, Any], place: str) -> Surface:
    """Return the surface of a mesh that lists its vertices and triangles."""
    points = check_list(table.get("vertices"), f"vertices of {place}")
    triangles = check_list(table.get("triangles"), f"triangles of {place}")
    corners = [_parse_triangle(each, place) for each in triangles]
    vertices = np.array(
        [parse_numbers(each, 3, f"vertices of {place}") for each in points]
    ).reshape(-1, 3)
    for triangle in corners:
        if len(triangle) != 3 or not all(type(n) is int and 0 <= n < len(points) for n in triangle):
            problem = (
                f"has a triangle that is not three numbers of its {len(points)} vertices at {place}"
            )
            raise ContentError(problem, "vertices count from 0", "correct it")
    return vertices, np.array(corners, dtype=np.int64).reshape(-1, 3)


def _parse_triangle(item: Any, place: str) -> Sequence[Any]:
    """Return the corners of a triangle, a list or a ``shape_msgs/MeshTriangle``."""
    if isinstance(item, dict):
        item = check_table(item, place, ("vertex_indices",)).get("vertex_indices")
    return check_list(item, place)


def _make_bounded_shape(
    make: Callable[[float, float], BoundsPair], height: float, radius: float
) -> Shape:
    """Make a solid of revolution from its outer and inner surface."""
    outer, inner = make(radius, height)
    return BoundedShape(Mesh.of(outer), Mesh.of(inner), is_round_about_z=True)


_BOX: Final = "box", ("x", "y", "z"), lambda *sides: Box.of(sides)
_SPHERE: Final = "sphere", ("radius",), lambda radius: Balls.of([(0.0, 0.0, 0.0)], radius)
_CYLINDER: Final = "cylinder", ("height", "radius"), partial(_make_bounded_shape, cylinder_bounds)
_CONE: Final = "cone", ("height", "radius"), partial(_make_bounded_shape, cone_bounds)

_PRIMITIVES: Final[Mapping[Any, tuple[str, tuple[str, ...], Callable[..., Shape]]]] = {
    **{kind[0]: kind for kind in (_BOX, _SPHERE, _CYLINDER, _CONE)},
    **dict(enumerate((_BOX, _SPHERE, _CYLINDER, _CONE), start=1)),
}
"""Primitives by the name and by the number of their type: name, dimensions in order, and maker."""


def parse_primitive(item: Any, place: str) -> tuple[str, list[float]]:
    """Return the kind of a ``shape_msgs/SolidPrimitive``, and its dimensions in metres.

    Raises ContentError if it is no box, sphere, cylinder or cone, or a dimension is missing or not
    above zero.
    """
    table = check_table(item, place, ("type", "dimensions", "polygon"))
    if check_table(table.get("polygon"), f"polygon of {place}", ("points",)).get("points"):
        raise ContentError(
            f"has a polygon at {place}", "only prisms have one, and they are not read", "remove it"
        )
    kind = table.get("type")
    kind = kind.lower() if isinstance(kind, str) else kind
    if isinstance(kind, bool) or not isinstance(kind, str | int) or kind not in _PRIMITIVES:
        known = ", ".join(
            f"{name} ({key})" for key, (name, _, _) in _PRIMITIVES.items() if isinstance(key, int)
        )
        problem = f"has the type {kind!r} at {place}"
        raise ContentError(problem, f"it must be one of {known}", "write such a primitive")
    name, sizes, _ = _PRIMITIVES[kind]
    given = check_list(table.get("dimensions"), f"dimensions of {place}")
    values = parse_numbers(given, len(given), f"dimensions of {place}")
    # Messages often pad dimensions to three numbers with zeros.
    if (
        len(values) < len(sizes)
        or values[len(sizes) :].any()
        or not (values[: len(sizes)] > 0.0).all()
    ):
        rule = f"a {name} has {', '.join(sizes)}, metres above zero"
        raise ContentError(f"has the dimensions {values.tolist()} at {place}", rule, "correct them")
    return name, values[: len(sizes)].tolist()


def _transform(shape: Shape, pose: Floats) -> Shape:
    """Apply a rigid motion, shape (4, 4), to a shape."""
    if isinstance(shape, BoundedShape):
        upright = (
            shape.is_round_about_z
            and np.array_equal(pose[:3, 2], (0.0, 0.0, 1.0))
            and not pose[:2, 3].any()
        )
        outer, inner = _transform_exact(shape.outer, pose), _transform_exact(shape.inner, pose)
        return BoundedShape(outer, inner, is_round_about_z=bool(upright))
    return _transform_exact(shape.outer, pose)


def _transform_exact(shape: ExactShape, pose: Floats) -> ExactShape:
    """Move a shape by a pose, shape (4, 4)."""
    if isinstance(shape, Balls):
        return Balls.of(shape.centers @ pose[:3, :3].T + pose[:3, 3], shape.radii)
    if isinstance(shape, Box) and np.array_equal(pose[:3, :3], np.eye(3)):
        return Box.of(shape.extents, shape.center + pose[:3, 3])
    if isinstance(shape, Mesh):
        return Mesh(
            *transform_surface((shape.vertices, shape.faces), pose), shape.solid, shape.source
        )
    return Mesh(*transform_surface(shape.surface, pose))
