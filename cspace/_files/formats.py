"""Formats of files of workspaces and robots by suffix, and the readers that wings provide."""

from __future__ import annotations

from typing import Final, NamedTuple

from cspace import _outside
from cspace._files import meshes, ros_maps, vector
from cspace._files.access import check_suffix
from cspace._files.lazy_arrays import read_npy
from cspace._files.polygons import read_ply_header
from cspace._support.arrays import StrPath


class Format(NamedTuple):
    """Reader and description of the files of one suffix.

    Attributes
    ----------
    method : str
        Name of the classmethod of ``Workspace`` or ``Robot`` that reads them.
    dimension : int or None
        2 in the plane, 3 in space; None if it depends on the file.
    summary : str
        Content of such a file, for the documentation.
    options : tuple of str
        Options of ``Robot.open`` that apply to such a file.
    """

    method: str
    dimension: int | None
    summary: str
    options: tuple[str, ...] = ()


_IMAGE_SUFFIXES: Final = (
    ".png",
    ".pgm",
    ".ppm",
    ".pbm",
    ".pnm",
    ".jpg",
    ".jpeg",
    ".bmp",
    ".tif",
    ".tiff",
)

WORKSPACE_FORMATS: Final[dict[str, Format]] = {
    **dict.fromkeys(
        ros_maps.YAML_SUFFIXES,
        Format(
            "_from_ros_map", 2, "a ROS map with its PGM or PNG, all three modes, turned origins too"
        ),
    ),
    **dict.fromkeys(_IMAGE_SUFFIXES, Format("_from_image", 2, "an image, dark pixels occupied")),
    ".map": Format("_from_movingai", 2, "a MovingAI map"),
    ".3dmap": Format("_from_movingai", 3, "a MovingAI map of voxels"),
    **dict.fromkeys(
        vector.POLYGON_SUFFIXES,
        Format("from_polygons", 2, "polygons, lines and points; zones of type BLOCKED of VDA 5050"),
    ),
    **dict.fromkeys(
        meshes.MESH_SUFFIXES,
        Format("from_mesh", 3, "a mesh; a `.ply` without faces is a point cloud"),
    ),
    **dict.fromkeys((".bt", ".ot"), Format("_from_octomap", 3, "an OctoMap")),
    **dict.fromkeys(
        (".xyz", ".txt", ".csv", ".pcd"),
        Format(
            "from_points", 3, "a point cloud, with a radius; `.pcd` of `ascii` or `binary` data"
        ),
    ),
    ".npy": Format("from_array", None, "a boolean array, or points: rows of three floats"),
    ".zarr": Format(
        "from_array",
        None,
        "a boolean array of Zarr version 3, raw or in zstd, read when needed",
    ),
}
"""Formats of workspace files, by suffix."""

ROBOT_FORMATS: Final[dict[str, Format]] = {
    **dict.fromkeys(vector.POLYGON_SUFFIXES, Format("polygon", 2, "polygons")),
    **dict.fromkeys(
        meshes.MESH_SUFFIXES, Format("from_mesh", 3, "a triangle mesh", options=("solid", "up"))
    ),
    ".urdf": Format(
        "from_urdf",
        3,
        "the fixed base of a URDF, or links of it: `FILE.urdf#LINK,LINK`",
        options=("solid", "package_dirs", "visuals"),
    ),
    **dict.fromkeys(
        ros_maps.YAML_SUFFIXES,
        Format("nav2", 2, "the footprint in Nav2's parameters, or that of `FILE.yaml#COSTMAP`"),
    ),
}
"""Formats of robot files, by suffix."""


read_rigid_links = _outside.read_rigid_links
read_obstacles = _outside.read_obstacles
"""Readers of URDF files and of planning scenes."""


def find_constructor(path: StrPath) -> str:
    """Return the name of the ``Workspace`` classmethod that reads a file.

    The suffix decides, then the header.

    Raises InputError if the suffix is unknown. Raises FileError if the header is needed and is
    missing or malformed.
    """
    suffix = check_suffix(path, WORKSPACE_FORMATS, "the suffix selects the format")
    if suffix == ".npy":
        array = read_npy(path)
        holds_points = array.dtype.kind == "f" and array.ndim == 2
        return "from_points" if holds_points else "from_array"
    if suffix == ".ply":
        header = read_ply_header(path)
        return "from_mesh" if header.faces else "from_points"
    return WORKSPACE_FORMATS[suffix].method
