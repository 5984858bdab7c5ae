"""Shapes of URDF links, and of objects in MoveIt planning scenes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from cspace import make_mesh
from cspace.arms._checks import check_distinct, check_names
from cspace.arms._reading.moveit_messages import (
    FIELDS,
    SCENE,
    WORLD,
    Contacts,
    find_frame,
    pair_poses,
    parse,
    wrong_value,
)
from cspace.arms._reading.urdf import (
    Collision,
    PackageDirs,
    RobotDescription,
    find_meshes,
    fixed_links,
    load_urdf,
    locate_meshes,
    name_description,
    package_folders,
    warn_of_visuals,
    zero_poses,
)
from cspace.errors import GeometryError, InputError
from cspace.inside import (
    Balls,
    ContentError,
    Floats,
    Ints,
    Ledger,
    Mesh,
    Shape,
    StrPath,
    Surface,
    check_finite,
    check_known,
    check_positive,
    check_word,
    join_surfaces,
    primitives,
    read_mesh,
    transform_surface,
    warn_of_size,
    warn_user,
)

SolidMode: TypeAlias = Literal["auto", "surface"]
"""Parts of a link's mesh that are solid: its closed bodies, or none."""


def read_rigid_links(
    path: StrPath,
    link: str | Sequence[str] | None,
    solid: Literal["auto", "surface", "fill"],
    package_dirs: PackageDirs,
    visuals: bool,
    spheres: StrPath | None,
) -> tuple[str, Shape]:
    """Read the name and the shape of a rigid robot from a URDF.

    Parameters and errors are as for :meth:`cspace.Robot.from_urdf`.
    """
    check_word(solid, "solid", ("auto", "surface", "fill"))
    surfaces = _read_surfaces(path, link, package_dirs, solid != "surface", visuals, spheres)
    name = Path(name_description(path)).name
    # Surfaces around and inside the links, or a single one if their meshes are exact.
    outer, *inner = (Mesh(*surface, solid, name) for surface in surfaces)
    outer.check_origin()
    if link is not None:
        links = link if isinstance(link, str) else ", ".join(link)
        name = f"{name} {links}"
    shape = make_mesh(outer)
    return name, shape.with_inner(inner[0]) if inner else shape


def _read_surfaces(
    path: str | os.PathLike[str],
    link: str | Sequence[str] | None,
    package_dirs: PackageDirs,
    primitives: bool,
    visuals: bool,
    spheres: str | os.PathLike[str] | None,
) -> list[Surface]:
    """Read the surface of a robot's collision geometry, metres.

    It is in the frame of the first link. If a shape is curved, return an outer and an inner
    surface. Without `primitives`, only meshes are accepted; for others, see
    :func:`read_rigid_links`.
    """
    folders = package_folders(package_dirs)
    file = name_description(path)
    urdf = load_urdf(path, visuals, spheres)
    links = fixed_links(urdf) if link is None else check_names(link, "link")
    for name in links:
        check_known(name, "link", urdf.links)
    warn_of_visuals(urdf, urdf.links if link is None else links, file)
    # The bounds of all collision geometries, moved to the frame of the first link.
    outer_surfaces = []
    inner_surfaces = []
    is_curved = False
    meshes = find_meshes(urdf, links, file, folders)
    poses = zero_poses(urdf)
    for name in links:
        # Solving by the first link's pose gives the pose relative to it.
        pose: Floats = np.linalg.solve(poses[links[0]], poses[name]).astype(np.float64)
        for place, collision in _iterate_collisions(urdf, name, file):
            if not primitives and collision.kind != "mesh":
                problem = (
                    f"is 'surface', and {place} is a box, a cylinder or a sphere, which is solid"
                )
                rule = "only a mesh can be a surface without an inside"
                raise InputError("solid", problem, rule)
            transform = pose @ collision.pose
            outer, inner = _make_bounds(collision, meshes, place)
            outer_surfaces.append(transform_surface(outer, transform))
            inner_surfaces.append(transform_surface(inner, transform))
            is_curved |= inner is not outer
    _check_shapes(urdf, link, links, file)
    sides = [outer_surfaces, inner_surfaces] if is_curved else [outer_surfaces]
    return [join_surfaces(side) for side in sides]


def _check_shapes(
    urdf: RobotDescription, chosen: str | Sequence[str] | None, links: Sequence[str], file: str
) -> None:
    """Raise InputError if links have no collision geometry.

    Warns if links that move are left out, unless the user has chosen ``links``.
    """
    with_geometry = [name for name in urdf.links if urdf.links[name].collisions]
    omitted = [name for name in with_geometry if name not in links]
    if len(omitted) == len(with_geometry):
        problem = f"is {', '.join(links) or 'empty'}"
        rule = f"links with collision geometry are {', '.join(with_geometry) or 'none'}"
        raise InputError("link", problem, rule)
    if chosen is None and omitted:
        problem = f"{file}: {', '.join(omitted)} move against {links[0]} and are omitted"
        warn_user(problem)


def _iterate_collisions(
    urdf: RobotDescription, link: str, file: str
) -> Iterator[tuple[str, Collision]]:
    """Yield each collision geometry of a link, after its place for messages."""
    for number, collision in enumerate(urdf.links[link].collisions):
        yield f"{file}: link {link!r}, collision {number}", collision


def link_shapes(
    urdf: RobotDescription,
    link: str,
    path: str | os.PathLike[str],
    meshes: Mapping[str, Path],
    solid: SolidMode,
) -> Iterator[tuple[Shape, Floats]]:
    """Yield the shapes of a link and their poses.

    Poses are in the frame of the link, shape (4, 4). `meshes` are the files from
    :func:`find_meshes`; `solid` says which part of a mesh is solid.

    Raises FileError if a mesh is malformed, and InputError if a size is not above zero.
    """
    for place, collision in _iterate_collisions(urdf, link, os.fspath(path)):
        outer_surface, inner_surface = _make_bounds(collision, meshes, place)
        solid_part = solid if collision.kind == "mesh" else "auto"
        outer = Mesh(*outer_surface, solid_part, place)
        outer.warn_if_open(fills=False)
        if collision.kind != "mesh":
            warn_of_size(place, outer_surface[0])
        shape: Shape = outer
        if inner_surface is not outer_surface:
            shape = outer.with_inner(make_mesh(inner_surface))
        yield shape, collision.pose


def _make_bounds(
    collision: Collision, meshes: Mapping[str, Path], place: str
) -> tuple[Surface, Surface]:
    """Return an outer and an inner surface of a collision geometry, metres.

    They are the same object if the geometry is not curved.
    """
    place = f"{place}: {collision.kind}"
    if collision.kind == "mesh":
        surface = _scale_mesh(meshes[collision.file], collision.sizes, place, "y")
        return surface, surface
    for size in collision.sizes:
        check_positive(size, f"{place}: size")
    if collision.kind == "box":
        surface = primitives.box(collision.sizes).shape.outer.surface
        return surface, surface
    if collision.kind == "cylinder":
        solid = primitives.cylinder(*collision.sizes).shape
    else:
        solid = primitives.capsule(collision.sizes[0], 0.0).shape
    return solid.outer.surface, solid.inner.surface


def _scale_mesh(file: Path, scale: Any, place: str, gltf_up: Literal["y", "z"]) -> Surface:
    """Read the surface of a mesh, scaled by one factor or three.

    ``gltf_up`` is the axis of a glTF file that becomes z.
    """
    scale = 1.0 if scale is None else scale
    factors = check_finite(np.broadcast_to(scale, 3), f"{place}: scale")
    if not factors.all():
        problem = f"is {factors.tolist()}"
        rule = "no factor may be zero"
        raise InputError(f"{place}: scale", problem, rule)
    is_gltf = file.suffix.lower() in (".glb", ".gltf")
    if is_gltf:
        turned = "it is turned upright, as in rviz and Drake; MoveIt keeps its axes"
        kept = "its axes stay as they are, as in MoveIt"
        what = turned if gltf_up == "y" else kept
        warn_user(f"{place}: y points up in the glTF file {file.name}; {what}")
    surface = read_mesh(file, gltf_up if is_gltf else "z", in_metres=bool((factors == 1.0).all()))
    surface = transform_surface(surface, np.diag([*factors, 1.0]))
    warn_of_size(place, surface[0], factors)
    return surface


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
    frame : str
        Frame of the object: the planning frame, or the link that carries it.
    link : str
        Link that carries it; empty for an obstacle.
    touch_links : tuple of str
        Further links that may touch it.
    """

    name: str
    shape: Shape
    pose: Floats
    object_id: str
    frame: str
    link: str = ""
    touch_links: tuple[str, ...] = ()


class SceneContent(NamedTuple):
    """Content of a planning scene.

    Attributes
    ----------
    source : str
        The file, or "planning scene" for a message.
    frame : str
        The planning frame.
    shapes : list of SceneShape
        Obstacles, and objects that the robot carries.
    joints : dict of str to float
        Values of the robot's joints.
    contacts : dict or None
        Entries and defaults of the allowed collision matrix, if there is one.
    """

    source: str
    frame: str
    shapes: list[SceneShape]
    joints: dict[str, float]
    contacts: Contacts | None

    def list_obstacles(self) -> list[Shape]:
        """Return the obstacles in the planning frame.

        A warning lists the attached objects, which are left out. Raises GeometryError if the scene
        has no obstacle.
        """
        obstacles = [
            _move_shape(scene_shape.shape, scene_shape.pose)
            for scene_shape in self.shapes
            if not scene_shape.link
        ]
        _check_not_empty(obstacles, self.source)
        carried = dict.fromkeys(each.object_id for each in self.shapes if each.link)
        if carried:
            problem = f"attached objects ({', '.join(carried)}) enlarge the robot and are not read"
            warn_user(f"{self.source}: {problem}")
        return obstacles


def _check_not_empty(shapes: Sequence[object], source: str) -> None:
    """Raise GeometryError for a scene without shapes."""
    if not shapes:
        raise GeometryError(source, "holds no shape", "a scene needs one")


def read_scene(source: object, package_dirs: PackageDirs = ()) -> SceneContent:
    """Read the shapes of a planning scene.

    Parameters
    ----------
    source : path-like, mapping, or message
        A ``moveit_msgs/PlanningScene``, or its ``world``; a file has it in YAML.
    package_dirs : path-like, or sequence of path-like
        Folders that hold the folders of packages, for meshes.

    Raises FileError, or InputError for a message, if it is missing or malformed, holds anything but
    boxes, spheres, cylinders, cones and meshes in one frame, or only changes another scene. Raises
    GeometryError if a mesh has no triangle.
    """
    folders = package_folders(package_dirs)
    with Ledger.reading(source, "planning scene", "scene", FIELDS[0]) as (name, document):
        document.skip()  # each of its tables has its ledger
        content = document.fields
        if "collision_objects" in content:
            content = {"world": content}
        fields = parse(SCENE, content, "scene")
        state = fields.robot_state
        shapes = list[SceneShape]()
        for item in fields.world.collision_objects:
            shapes += _read_object(item, name, folders)
        for item in state.attached_collision_objects:
            carried = _read_object(item.object, name, folders, item.link_name)
            touch_links = tuple(item.touch_links)
            shapes += [shape._replace(touch_links=touch_links) for shape in carried]
        # An object of several shapes has a name beside theirs.
        ids = {each.object_id for each in shapes if each.object_id != each.name}
        names = [each.name for each in shapes]
        check_distinct([*names, *ids], "", "ids and names of shapes must differ")
        _check_not_empty(shapes, name)
        frame = find_frame({each.frame for each in shapes if each.frame != each.link})
        contacts = fields.allowed_collision_matrix
        return SceneContent(name, frame, shapes, state.joint_state, contacts)


def read_obstacles(source: object, package_dirs: PackageDirs) -> tuple[list[Shape], str, str]:
    """Read the obstacles of a planning scene, its source and its frame; see :func:`read_scene`."""
    scene = read_scene(source, package_dirs)
    return scene.list_obstacles(), scene.source, scene.frame


def _read_object(
    item: Any, source: str, folders: Sequence[Path], link: str = ""
) -> list[SceneShape]:
    """Read the shapes of a collision object.

    ``link`` carries the object, unless it is empty. Mesh files lie beside the file `source` or in
    the folders.
    """
    name = item.id
    place = f"object {name!r}"
    if link and not item.header.frame_id:
        problem = f"has no header.frame_id at {place}"
        rule = "MoveIt and robowflex would take the frame of the world"
        raise ContentError(problem, rule)
    shapes: list[tuple[Shape, Floats]] = [
        (_PRIMITIVE_MAKERS[kind](*sizes), pose)
        for (kind, sizes), pose in pair_poses(item, "primitives", "primitive_poses", place)
    ]
    for number, (mesh, pose) in enumerate(pair_poses(item, "meshes", "mesh_poses", place)):
        shapes.append((_read_mesh(mesh, f"meshes[{number}] of {place}", source, folders), pose))
    if not shapes:
        rule = "it must have primitives or meshes"
        raise ContentError(f"has no shape at {place}", rule)
    # Several shapes of an object are numbered.
    names = [name]
    if len(shapes) > 1:
        names = [f"{name}/{number}" for number in range(len(shapes))]
    frame = item.header.frame_id or WORLD
    return [
        SceneShape(shape_name, shape, item.pose @ pose, name, frame, link)
        for shape_name, (shape, pose) in zip(names, shapes, strict=True)
    ]


def _read_mesh(mesh: Any, place: str, source: str, folders: Sequence[Path]) -> Mesh:
    """Read a mesh from the file that it names, or its triangles."""
    resource = mesh.resource
    dimensions = mesh.dimensions
    is_inline = bool(mesh.vertices or mesh.triangles)
    if is_inline and (resource or dimensions is not None):
        problem = f"has vertices and a resource or dimensions at {place}"
        raise ContentError(problem, "a mesh has one of them")
    if resource:
        files = locate_meshes({resource: place}, source, folders)
        surface = _scale_mesh(files[resource], dimensions, place, "z")
    else:
        surface = _read_inline_mesh(mesh, place)
    return Mesh(*surface, source=f"{source}: {place}")


def _read_inline_mesh(mesh: Any, place: str) -> Surface:
    """Return the surface of a mesh that lists its vertices and triangles."""
    count = len(mesh.vertices)
    vertex_numbers = set(range(count))
    triangles = [triangle.vertex_indices for triangle in mesh.triangles]
    for triangle in triangles:
        if len(triangle) != 3 or not vertex_numbers.issuperset(triangle):
            rule = f"it must be three numbers of its {count} vertices, from 0"
            raise wrong_value(triangle, f"a triangle of {place}", rule)
    vertices = np.array(mesh.vertices).reshape(-1, 3)
    return vertices, np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _make_cone(height: float, radius: float) -> Shape:
    """Make an upright cone, metres; the origin is halfway up its axis."""
    # The bounds of a cylinder, without its upper circle, bound the cone on its lower circle.
    solid = primitives.cylinder(radius, height).shape
    outer, inner = (_sharpen(*side.surface) for side in (solid.outer, solid.inner))
    return outer.with_inner(inner)


def _sharpen(vertices: Floats, faces: Ints) -> Mesh:
    """Join the upper vertices of a prism in one on the z axis."""
    upper = np.flatnonzero(vertices[:, 2] > 0.0)
    apex = upper[np.argmin(np.abs(vertices[upper, :2]).sum(axis=1))]
    joined = np.where(np.isin(faces, upper), apex, faces)
    # Triangles with two upper vertices have no area left.
    is_left = (np.isin(faces, upper)).sum(axis=1) < 2
    numbers, new_faces = np.unique(joined[is_left], return_inverse=True)
    return make_mesh((vertices[numbers], new_faces.reshape(-1, 3)))


_PRIMITIVE_MAKERS: Final[Mapping[str, Callable[..., Shape]]] = {
    "box": lambda *sides: primitives.box(sides).shape,
    "sphere": lambda radius: Balls.of([(0.0, 0.0, 0.0)], radius),
    "cylinder": lambda height, radius: primitives.cylinder(radius, height).shape,
    "cone": _make_cone,
}
"""Function that makes each primitive from its dimensions, metres."""


def _move_shape(shape: Shape, pose: Floats) -> Shape:
    """Apply a rigid motion (4, 4) to a shape."""
    rotation = pose[:3, :3]
    translation = pose[:3, 3]
    # Balls stay balls, and boxes that do not turn stay boxes; all else becomes a mesh.
    if isinstance(shape, Balls):
        return Balls.of(shape.centers @ rotation.T + translation, shape.radii)
    spec: Mapping[str, Any] = shape.spec
    if spec["kind"] == "box" and np.array_equal(rotation, np.eye(3)):
        return primitives.box(spec["extents"], np.asarray(spec["center"]) + translation).shape
    outer = transform_surface(shape.outer.surface, pose)
    if shape.inner is not shape.outer:
        inner = transform_surface(shape.inner.surface, pose)
        return make_mesh(outer).with_inner(make_mesh(inner))
    if isinstance(shape, Mesh):
        return Mesh(*outer, shape.solid, shape.source)
    return Mesh(*outer)
