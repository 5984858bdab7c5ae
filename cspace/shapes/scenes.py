"""Shapes of URDF links and of obstacles in MoveIt planning scenes.

Scenes are YAML, as ROS prints the message or as MotionBenchMaker writes it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cspace.arrays import Floats, StrPath, Surface
from cspace.check import check_finite, check_point, check_positive
from cspace.errors import GeometryError, InputError, warn_user
from cspace.files.access import ContentError, decoding
from cspace.files.meshes import read_mesh
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
    root_link,
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

    It is in the frame of the first link. Links are as for :meth:`cspace.Robot.from_urdf`. If a shape is curved, return
    an outer and an inner surface. Without `primitives`, only meshes are accepted.

    Raises FileError if the file or a mesh is missing or malformed. Raises InputError if a link is missing, the links
    have no collision geometry, or a size is not above zero. Raises MissingPackageError without yourdfpy.
    """
    folders = package_folders(package_dirs)
    file = os.fspath(path)
    urdf = load_urdf(path)
    base, rigid = root_link(urdf), fixed_links(urdf)
    links = rigid if link is None else [link] if isinstance(link, str) else list(link)
    for name in links:
        if name not in urdf.link_map:
            rule = f"{file} has {', '.join(urdf.link_map)}"
            raise InputError("link", f"is {name!r}", rule, "name one of these", value=name)
    pairs, meshes, poses = [], find_meshes(urdf, links, path, folders), zero_poses(urdf)
    for name in links:
        pose: Floats = np.linalg.solve(poses[links[0]], poses[name]).astype(np.float64)
        for number, collision in enumerate(urdf.link_map[name].collisions):
            place = f"{file}: link {name!r}, collision {number}"
            if not primitives and collision.geometry.mesh is None:
                problem = f"is 'surface', and {place} is a box, a cylinder or a sphere, which is solid"
                rule, hint = "only a mesh can be a surface without an inside", "omit it, or name links with only meshes"
                raise InputError("solid", problem, rule, hint, value="surface")
            transform = pose if collision.origin is None else pose @ check_finite(collision.origin, f"{place}: origin")
            outer, inner = _bounds_pair(collision.geometry, meshes, place)
            moved = transform_surface(outer, transform)
            pairs.append((moved, moved if inner is outer else transform_surface(inner, transform)))
    has_shape = [name for name in urdf.link_map if urdf.link_map[name].collisions]
    if not pairs:
        hint = f"name links that have: {', '.join(has_shape)}" if has_shape else "add <collision> to its links"
        problem = f"is {', '.join(links) or 'not there'}"
        raise InputError("link", problem, "no such link has collision geometry", hint, value=link)
    if link is None and (left := [name for name in has_shape if name not in rigid]):
        warn_user(
            f"{file}: {', '.join(left)} move against {base} and are omitted; to include them, name all links, which "
            "are placed with their joints at zero"
        )
    curved = any(outer is not inner for outer, inner in pairs)
    return [join_surfaces(side) for side in list(zip(*pairs, strict=True))[: 1 + curved]]


def link_shapes(
    urdf: URDF, link: str, path: str | os.PathLike[str], meshes: Mapping[str, Path], solid: Solid
) -> Iterator[tuple[Shape, Floats]]:
    """Yield the shapes of a link and their poses.

    Poses are in the frame of the link, shape (4, 4). `meshes` are the files from :func:`find_meshes`; `solid` says
    which part of a mesh is solid.

    Raises FileError if a mesh is malformed, and InputError if a size is not above zero.
    """
    for number, collision in enumerate(urdf.link_map[link].collisions):
        place = f"{os.fspath(path)}: link {link!r}, collision {number}"
        surface, within = _bounds_pair(collision.geometry, meshes, place)
        outer = Mesh(*surface, solid if collision.geometry.mesh is not None else "auto", place)
        outer.warn_if_open(fills=False)
        shape = outer if within is surface else BoundedShape(outer, Mesh.of(within))
        yield shape, np.eye(4) if collision.origin is None else check_finite(collision.origin, f"{place}: origin")


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
    scale = check_finite(np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3), f"{place}: scale")
    if not scale.all():
        raise InputError(f"{place}: scale", f"is {scale.tolist()}", "no factor may be zero", "correct it", value=scale)
    surface = transform_surface(read_mesh(meshes[str(mesh.filename)]), np.diag([*scale, 1.0]))
    return surface, surface


def _make_curved_bounds(
    make: Callable[..., BoundsPair], names: Sequence[str], shape: Any, meshes: Mapping[str, Path], place: str
) -> BoundsPair:
    """Make the outer and the inner surface of a curved shape of a URDF.

    ``make`` takes the sizes that ``shape`` has under ``names``. ``meshes`` is unused: makers share one signature.
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


_SCENE_KIND: Final = "planning scene"

MAX_SHAPES: Final = 10_000
"""Maximum number of shapes in one scene."""

_ADD, _REMOVE, _APPEND, _MOVE = range(4)

_OPERATIONS: Final[Mapping[object, int]] = {
    **{word: number for number, word in enumerate(("add", "remove", "append", "move"))},
    **{number: number for number in range(4)},
    **{chr(number): number for number in range(4)},
}
"""Operations of a collision object, as words, numbers, or the byte that ROS 2 prints."""

_POSE_LISTS: Final = {"primitives": "primitive_poses", "meshes": "mesh_poses", "planes": "plane_poses"}
"""For each list of shapes in a collision object, the list of their poses."""

_IDENTITY_QUATERNION: Final = (0.0, 0.0, 0.0, 1.0)

Ball = tuple[Floats, float]


class SceneShape(NamedTuple):
    """A shape of a planning scene.

    Attributes
    ----------
    name : str
        Id of its collision object, with ``/0``, ``/1`` and so on if that holds several shapes.
    shape : Shape
    pose : ndarray of float64, shape (4, 4)
        Motion from the frame of the shape to the frame of the scene.
    """

    name: str
    shape: Shape
    pose: Floats

    def moved(self) -> Shape:
        """Return the shape in the frame of the scene."""
        return _transform(self.shape, self.pose)


def read_moveit_scene(
    path: StrPath, plane_ball: Ball | None = None, package_dirs: PackageDirs = ()
) -> list[SceneShape]:
    """Read the obstacles of a planning scene.

    A warning lists the parts of the scene that enlarge the robot; they are not read.

    Parameters
    ----------
    path : path-like
        YAML of a ``moveit_msgs/PlanningScene``, or of its ``world``.
    plane_ball : (ndarray of float64, shape (3,), float), optional
        Center and radius of a ball, metres. Each plane, which has no end, becomes a square that covers its part in the
        ball.
    package_dirs : path-like, or sequence of path-like
        Folders that hold the folders of packages, for meshes.

    Raises FileError if the file is missing or malformed, or holds anything but boxes, spheres, cylinders, cones, meshes
    and planes. Raises GeometryError if a mesh has no triangle or the scene has no shape.
    """
    folders = package_folders(package_dirs)
    content = read_yaml(path, _SCENE_KIND)
    with decoding(path, _SCENE_KIND):
        scene = _check_table(content, "the file")
        world = _check_table(scene.get("world", scene), "world")
        if "collision_objects" not in world:
            rule = "a planning scene lists its obstacles there"
            raise ContentError("has no world.collision_objects", rule, "pass the YAML of a moveit_msgs/PlanningScene")
        octomap = _check_table(_check_table(world.get("octomap"), "octomap").get("octomap"), "octomap")
        if octomap.get("data"):
            hint = "save it as .bt, read it with Workspace.from_octomap, and remove it here"
            raise ContentError("holds an OctoMap", "only collision objects are read", hint)
        reader = _Reader(path, plane_ball, folders)
        objects = reader.objects(_check_list(world["collision_objects"], "collision_objects"))
        frames = {frame for frame, _ in objects.values()}
        to_scene = _find_frame_motions(
            _check_list(scene.get("fixed_frame_transforms"), "fixed_frame_transforms"), frames
        )
        shapes = [
            SceneShape(name if len(parts) == 1 else f"{name}/{number}", shape, to_scene[frame] @ pose)
            for name, (frame, parts) in objects.items()
            for number, (shape, pose) in enumerate(parts)
        ]
        if not shapes:
            raise GeometryError(os.fspath(path), "holds no shape", "a scene needs one", "pass another file")
        if left_out := _list_robot_parts(scene):
            listed = ", ".join(left_out)
            warn_user(f"{os.fspath(path)}: {listed} enlarge the robot and are not read; use arm.attach and margin=")
        return shapes


class _Reader:
    """Maker of the shapes of collision objects."""

    def __init__(self, path: StrPath, plane_ball: Ball | None, folders: Sequence[Path]) -> None:
        self._path, self._plane_ball, self._folders = path, plane_ball, folders
        self._meshes: dict[str, Surface] = {}
        self._count, self._bytes = 0, 0

    def objects(self, items: Sequence[Any]) -> dict[str, tuple[str, list[tuple[Shape, Floats]]]]:
        """Return the objects by id after all operations.

        Each has a frame, and shapes with their poses.
        """
        objects: dict[str, tuple[str, list[tuple[Shape, Floats]]]] = {}
        for number, item in enumerate(items):
            entry = _check_table(item, f"collision_objects[{number}]")
            name = str(entry.get("id") or f"object {number}")
            operation = entry.get("operation") or _ADD
            operation = operation.lower() if isinstance(operation, str) else operation
            if operation not in _OPERATIONS or _OPERATIONS[operation] == _MOVE:
                problem = f"has the operation {operation!r} at object {name!r}"
                raise ContentError(problem, "it must be add, append or remove (0, 2 or 1)", "write the scene as it is")
            if _OPERATIONS[operation] == _REMOVE:
                objects.pop(name, None)
                continue
            header = _check_table(entry.get("header"), f"the header of object {name!r}")
            frame = str(header.get("frame_id") or "").lstrip("/")
            parts = list(self._read_shapes(entry, f"object {name!r}"))
            if not parts:
                rule = "it must have primitives, meshes or planes"
                raise ContentError(f"has no shape at object {name!r}", rule, "add them, or remove the object")
            if _OPERATIONS[operation] == _APPEND and name in objects:
                if objects[name][0] != frame:
                    problem = f"appends to object {name!r} in frame {frame!r}, which is in frame {objects[name][0]!r}"
                    raise ContentError(problem, "frames must be equal", "write both in one frame")
                parts = [*objects[name][1], *parts]
            objects[name] = frame, parts
        return objects

    def _read_shapes(self, entry: Mapping[str, Any], place: str) -> Iterator[tuple[Shape, Floats]]:
        """Yield the shapes of an object, with their poses."""
        whole = _parse_pose(entry.get("pose"), f"the pose of {place}")
        makers: dict[str, Callable[[Any, str, Floats], tuple[Shape, Floats]]]
        makers = {"primitives": self._read_primitive, "meshes": self._read_mesh, "planes": self._read_plane}
        for name, poses_name in _POSE_LISTS.items():
            items = _check_list(entry.get(name), f"{name} of {place}")
            poses = _check_list(entry.get(poses_name), f"{poses_name} of {place}")
            if len(poses) != len(items) and (poses or len(items) > 1):
                problem = f"has {len(items)} {name} but {len(poses)} {poses_name} at {place}"
                raise ContentError(problem, "each needs a pose", "add or remove some")
            for number, item in enumerate(items):
                self._count += 1
                if self._count > MAX_SHAPES:
                    problem = f"holds more than {MAX_SHAPES} shapes"
                    raise ContentError(problem, "the rest is not read", "split the scene")
                here = f"{name}[{number}] of {place}"
                pose = _parse_pose(poses[number] if poses else None, f"{poses_name}[{number}] of {place}")
                yield makers[name](item, here, whole @ pose)

    def _read_primitive(self, item: Any, place: str, pose: Floats) -> tuple[Shape, Floats]:
        """Return a primitive as a shape, with its pose."""
        table = _check_table(item, place)
        kind = table.get("type")
        kind = kind.lower() if isinstance(kind, str) else kind
        if isinstance(kind, bool) or kind not in _PRIMITIVES:
            known = ", ".join(f"{name} ({key})" for key, (name, _, _) in _PRIMITIVES.items() if isinstance(key, int))
            problem = f"has the type {kind!r} at {place}"
            raise ContentError(problem, f"it must be one of {known}", "write such a primitive")
        name, sizes, make = _PRIMITIVES[kind]
        given = _check_list(table.get("dimensions"), f"dimensions of {place}")
        values = _parse_numbers(given, len(given), f"dimensions of {place}")
        # Messages often pad dimensions to three numbers with zeros.
        if len(values) < len(sizes) or values[len(sizes) :].any() or not (values[: len(sizes)] > 0.0).all():
            rule = f"a {name} has {', '.join(sizes)}, metres above zero"
            raise ContentError(f"has the dimensions {values.tolist()} at {place}", rule, "correct them")
        return make(*values[: len(sizes)].tolist()), pose

    def _read_mesh(self, item: Any, place: str, pose: Floats) -> tuple[Shape, Floats]:
        """Return a mesh as a shape, with its pose."""
        table = _check_table(item, place)
        if table.get("resource"):
            name = str(table["resource"])
            if name not in self._meshes:
                self._meshes[name] = read_mesh(locate_meshes({name: place}, self._path, self._folders)[name])
            scale = np.ones(3)
            if table.get("dimensions") is not None:
                scale = _parse_numbers(table["dimensions"], 3, f"dimensions of {place}")
            if not scale.all():
                problem = f"has the dimensions {scale.tolist()} at {place}"
                raise ContentError(problem, "no factor may be zero", "correct them")
            vertices, faces = transform_surface(self._meshes[name], np.diag([*scale, 1.0]))
        else:
            points = _check_list(table.get("vertices"), f"vertices of {place}")
            corners = [
                _check_list(_check_table(each, place).get("vertex_indices") if isinstance(each, dict) else each, place)
                for each in _check_list(table.get("triangles"), f"triangles of {place}")
            ]
            vertices = np.array([_parse_numbers(each, 3, f"vertices of {place}") for each in points]).reshape(-1, 3)
            if any(
                len(each) != 3 or not all(type(n) is int and 0 <= n < len(points) for n in each) for each in corners
            ):
                problem = f"has a triangle that is not three numbers of its {len(points)} vertices at {place}"
                raise ContentError(problem, "vertices count from 0", "correct it")
            faces = np.array(corners, dtype=np.int64).reshape(-1, 3)
        self._bytes += surface_bytes(len(vertices), len(faces))
        check_file_memory(self._path, "holds meshes", self._bytes)
        return Mesh(vertices, faces, source=f"{os.fspath(self._path)}: {place}"), pose

    def _read_plane(self, item: Any, place: str, pose: Floats) -> tuple[Shape, Floats]:
        """Return a plane as a shape, cut to a ball."""
        if self._plane_ball is None:
            hint = "pass bounds for a workspace, or plane_radius for an arm"
            raise ContentError(f"has a plane, {place}", "a plane has no end, but an obstacle needs one", hint)
        *normal, offset = _parse_numbers(_check_table(item, place).get("coef"), 4, f"coef of {place}").tolist()
        length = float(np.linalg.norm(normal))
        if not length > 0.0:
            problem = f"has the coef {[*normal, offset]} at {place}"
            raise ContentError(problem, "a, b and c may not all be zero", "correct it")
        direction = pose[:3, :3] @ np.divide(normal, length)
        center, radius = self._plane_ball
        # In its own frame, the plane holds the points x with normal . x + offset = 0.
        foot = center - direction * (direction @ (center - pose[:3, 3]) + offset / length)
        across = np.linalg.svd(direction[np.newaxis])[2][1:]
        corners = foot + radius * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) @ across
        return Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)]), "surface", place), np.eye(4)


def _make_bounded_shape(make: Callable[[float, float], BoundsPair], height: float, radius: float) -> Shape:
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


def _transform(shape: Shape, pose: Floats) -> Shape:
    """Apply a rigid motion, shape (4, 4), to a shape."""
    if isinstance(shape, BoundedShape):
        upright = shape.is_round_about_z and np.array_equal(pose[:3, 2], (0.0, 0.0, 1.0)) and not pose[:2, 3].any()
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
        return Mesh(*transform_surface((shape.vertices, shape.faces), pose), shape.solid, shape.source)
    return Mesh(*transform_surface(shape.surface, pose))


def _find_frame_motions(transforms: Sequence[Any], frames: set[str]) -> dict[str, Floats]:
    """Return the motion from each frame to the scene's frame.

    If all objects share a frame, it is the frame of the scene. Otherwise the transforms must lead to one frame.
    """
    if len(frames) == 1:
        return dict.fromkeys(frames, np.eye(4))
    parents: dict[str, tuple[str, Floats]] = {}
    for number, item in enumerate(transforms):
        place = f"fixed_frame_transforms[{number}]"
        entry = _check_table(item, place)
        header, motion = _check_table(entry.get("header"), place), _check_table(entry.get("transform"), place)
        parent = str(header.get("frame_id") or "").lstrip("/")
        given = {"position": motion.get("translation"), "orientation": motion.get("rotation")}
        parents[str(entry.get("child_frame_id") or "").lstrip("/")] = parent, _parse_pose(given, place)
    motions: dict[str, Floats] = {}
    roots: set[str] = set()
    for frame in sorted(frames):
        root, to_root, passed = frame, np.eye(4), {frame}
        while root in parents and parents[root][0] not in passed:
            root, step = parents[root]
            to_root = step @ to_root
            passed.add(root)
        motions[frame] = to_root
        roots.add(root)
    if len(roots) > 1:
        problem = f"has objects in the frames {', '.join(map(repr, sorted(frames)))}"
        raise ContentError(problem, "fixed_frame_transforms must lead from all to one frame", "write all in one frame")
    return motions


def _list_robot_parts(scene: Mapping[str, Any]) -> list[str]:
    """Return the parts of a scene that enlarge the robot, as text."""
    state = _check_table(scene.get("robot_state"), "robot_state")
    attached = _check_list(state.get("attached_collision_objects"), "attached_collision_objects")
    names = [str(_check_table(_check_table(each, "").get("object"), "").get("id")) for each in attached]
    found = [f"attached objects ({', '.join(names)})"] if names else []
    for key, field, neutral in (("link_padding", "padding", 0.0), ("link_scale", "scale", 1.0)):
        if any(_check_table(each, key).get(field, neutral) != neutral for each in _check_list(scene.get(key), key)):
            found.append(key)
    return found


def _parse_pose(value: Any, place: str) -> Floats:
    """Parse a pose as a rigid motion, shape (4, 4).

    The default is the identity. Like MoveIt, normalise quaternions.
    """
    table = _check_table(value, place)
    given = table.get("position"), table.get("orientation")
    position = np.zeros(3) if given[0] is None else _parse_numbers(given[0], 3, f"position of {place}")
    quaternion = np.array(_IDENTITY_QUATERNION)
    if given[1] is not None:
        quaternion = _parse_numbers(given[1], 4, f"orientation of {place}")
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if quaternion[:3].any():
        from scipy.spatial.transform import Rotation

        matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    return matrix


def _check_table(value: Any, place: str) -> Mapping[str, Any]:
    """Return a table, empty for None."""
    if value is not None and not isinstance(value, dict):
        problem = f"has {str(value)[:40]!r} as {place}"
        raise ContentError(problem, "it must be a table of names and values", "correct it")
    return value or {}


def _check_list(value: Any, place: str) -> Sequence[Any]:
    """Return a list, empty for None."""
    if value is not None and not isinstance(value, list):
        raise ContentError(f"has {str(value)[:40]!r} as {place}", "it must be a list", "correct it")
    return value or []


def _parse_numbers(value: Any, count: int, place: str) -> Floats:
    """Parse numbers, shape (count,), from a list or table.

    A table holds x, y, z and w.
    """
    if isinstance(value, dict):
        value = [value.get(name) for name in "xyzw"[:count]] if len(value) == count else None
    if (
        not isinstance(value, list)
        or len(value) != count
        or not all(type(each) in (int, float) and abs(each) < 1e100 for each in value)
    ):
        raise ContentError(f"has {str(value)[:60]} as {place}", f"it must be {count} finite numbers", "correct it")
    return np.array(value, dtype=np.float64)
