"""Kinds of values that are not taken as they are, and the calls that take them."""

from __future__ import annotations

import numbers
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace.errors import InputError

BRING_YOUR_FILE: Final = 'the page "Bring your file" says how'
"""Hint for files and values that other packages convert."""

_MAX_LEVELS: Final = 5
"""Largest number of nested lists that are looked into; lists may hold themselves."""

_CALLS: Final[Mapping[str, str]] = {
    "data_vars": "use {}[name] for one variable",  # which may have any names
    # Messages of ROS.
    "point_step data": "use point_cloud2.read_points({})",
    "angle_increment ranges": BRING_YOUR_FILE,
    "info data": "use cspace.Workspace.from_occupancy_grid({})",
    "world": (
        "use cspace.Workspace.from_moveit_scene({}, spacing), or "
        "cspace.arms.read_moveit_scene({}) for an arm"
    ),
    "header pose": "use cspace.ros.configuration_of({}, space)",
    "position orientation": (
        "use cspace.ros.configuration_of({'header': {'frame_id': 'map'}, 'pose': {}}, space)"
    ),
    "header transform": (
        "use cspace.ros.configuration_of({'header': {}.header, 'pose': {'position': "
        "{}.transform.translation, 'orientation': {}.transform.rotation}}, space)"
    ),
    "header poses": "use [cspace.ros.configuration_of(pose, space) for pose in {}.poses]",
    "name position velocity": "use arm.configuration({})",
    # Files of plain values.
    "Mapping levels name": f"a building of the traffic editor is in pixels; {BRING_YOUR_FILE}",
    "Mapping levels": "use cspace.lanes.RouteGraph.open({})",
    "Mapping layouts": "use cspace.lanes.RouteGraph.open({})",
    # Values of this library.
    "waypoints trajectory": "use {}.path for rows, or {}.trajectory(...) for a motion in time",
    "sample_uniform": "use {}.positions",
    "arrival_bound trajectory": "use {}.trajectory",
    "robot-argument cell_states": "use {}.robot",
    "cell_states": "use {}.workspace",
    # Values of other packages.
    "translation as_matrix": (
        "use {}.as_matrix() for an arm, or (*{}.translation, *{}.rotation.as_quat()) for a map"
    ),
    "as_quat": (
        "use {}.as_quat(), or {}.as_euler('xyz')[2] for its yaw, or "
        "scipy.linalg.block_diag({}.as_matrix(), 1) for a pose of an arm"
    ),
    "nodes adj": "use cspace.lanes.RouteGraph.from_networkx({})",
    "matrix pitch": (
        "use cspace.Workspace.from_array({}.matrix, {}.scale[0], {}.translation - {}.scale / 2)"
    ),
    "polygons_full": "use {}.polygons_full",
    "to_polygons": "use [shapely.Polygon(ring) for ring in {}.to_polygons()] for straight edges",
    "get_corners rotation_point": "use shapely.Polygon({}.get_corners())",
    "get_xy get_closed": "use shapely.Polygon({}.get_xy())",
    "vertices faces": "use cspace.make_mesh(({}.vertices, {}.faces))",
    "vertices triangles": "use cspace.make_mesh(({}.vertices, {}.triangles))",
    "vertices kdtree": "use cspace.Workspace.from_points({}.vertices, spacing, radius=spacing / 2)",
    "points regular_faces": (
        "use cspace.make_mesh(({}.points, {}.triangulate().regular_faces)), or {}.points for a "
        "cloud"
    ),
    "extract_surface points_to_double": "use {}.extract_surface()",
    "extract_surface combine": "use {}.combine()",
    "extract_surface": "use {}.threshold(lowest) for values of occupied cells",
    "points cells_dict": "use cspace.make_mesh(({}.points, {}.cells_dict['triangle']))",
    "extract_triangle_mesh": "use {}.extract_triangle_mesh()",
    "points normals": "use {}.points",
    "to_legacy": "use {}.to_legacy()",
    "get_box_points": "use trimesh.PointCloud({}.get_box_points()).convex_hull",
    "points get_line_coordinate": (
        "use cspace.make_mesh(({}.points, [(start, end, end) for start, end in {}.lines]))"
    ),
    "get_voxels voxel_size": (
        "use cspace.Workspace.from_points([{}.get_voxel_center_coordinate(voxel.grid_index) "
        "for voxel in {}.get_voxels()], {}.voxel_size, radius=0.87 * {}.voxel_size)"
    ),
    "writeBinary": "use {}.writeBinary(b'map.bt'); cspace.Workspace.open('map.bt') reads it",
    "cpu numpy": "use {}.cpu().numpy()",
    "fetchdf": "use {}.fetchdf()",
    "collect": "use {}.collect()",
    "toarray": "use {}.toarray()",
    **dict.fromkeys(
        [
            *("getpixel", "GetPixel", "create_pyramid"),  # pictures and volumes
            *("modelspace", "xyz header", "Octree", "MjModel", "URDF"),
        ],
        BRING_YOUR_FILE,
    ),
    # Nested lists of coordinates.
    "2-level-pairs": "use shapely.Polygon({})",
    "3-level-pairs": (
        "use {'type': 'Polygon', 'coordinates': {}} if further rings are holes, or "
        "[shapely.Polygon(ring) for ring in {}]"
    ),
    "4-level-pairs": "use {'type': 'MultiPolygon', 'coordinates': {}}",
}
"""Call that takes a value, by its type, attributes or keys; the first one that fits counts."""


def suggest_call(value: Any, name: str) -> str:
    """Return the call that takes a value, or the content of a file, of that name; or ""."""
    is_file = Path(name).suffix in (".yaml", ".yml", ".json", ".geojson")
    if is_file and isinstance(value, list):
        return BRING_YOUR_FILE
    features = {f"{name}-argument", type(value).__name__, *_list_features(value)}
    has_attributes = not isinstance(value, Mapping)
    for needed, call in _CALLS.items():
        if features.issuperset(needed.split()) and (has_attributes or "{}." not in call):
            return call.replace("{}", repr(name) if is_file else name)
    return ""


def _list_features(value: Any) -> set[str]:
    """Return the keys or attributes of a value, or the place of pairs in nested lists."""
    if isinstance(value, Mapping):
        return {"Mapping", *map(str, value), *dir(value)}
    if not isinstance(value, list | tuple | np.ndarray):
        return set(dir(value))
    shape: list[int] = []
    while isinstance(value, list | tuple) and value and len(shape) < _MAX_LEVELS:
        shape.append(len(value))
        value = value[0]
    shape += getattr(value, "shape", ())
    is_pair = shape[-1:] == [2] and isinstance(value, numbers.Real | np.ndarray)
    return {f"{len(shape)}-level-pairs"} if is_pair else set()


def make_kind_error(value: object, name: str, rule: str) -> InputError:
    """Make the error for a value, or an entry of a list, of another kind.

    Only short plain values are quoted.
    """
    entry, place = _find_foreign(value, name, _MAX_LEVELS) or (value, name)
    text = repr(entry) if _is_plain(entry) else ""
    if not 0 < len(text) < 100:
        text = f"a {type(entry).__name__}"
    return InputError(place, f"is {text}", rule, suggest_call(entry, place))


def _find_foreign(value: object, name: str, levels: int) -> tuple[object, str] | None:
    """Return the first entry that another package made, and its name."""
    if isinstance(value, list | tuple) and levels:
        entries = (
            _find_foreign(each, f"{name}[{number}]", levels - 1)
            for number, each in enumerate(value)
        )
        return next(filter(None, entries), None)
    is_plain = _is_plain(value) or isinstance(value, numbers.Number)
    return None if is_plain else (value, name)


def _is_plain(value: object) -> bool:
    """Return whether Python or numpy made a value's type."""
    return type(value).__module__ in ("builtins", "numpy")
