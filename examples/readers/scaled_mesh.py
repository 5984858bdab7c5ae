"""Read OFF, or a mesh in millimetres, with trimesh: the file knows no unit."""

import trimesh

import cspace


def read_scaled_mesh(path: str, unit: float = 0.001, spacing: float = 0.1) -> cspace.Workspace:
    """Read a mesh with ``unit`` metres a unit."""
    mesh = trimesh.load_mesh(path)
    mesh.apply_scale(unit)
    return cspace.Workspace.from_mesh(mesh, spacing)


if __name__ == "__main__":
    import sys

    print(read_scaled_mesh(sys.argv[1]))
