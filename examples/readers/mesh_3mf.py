"""Read a 3MF file, which knows its unit, with trimesh."""

import trimesh

import cspace


def read_3mf(path: str, spacing: float = 0.1) -> cspace.Workspace:
    """Read all meshes, in their places."""
    scene = trimesh.load_scene(path).convert_units("m")
    return cspace.Workspace.from_mesh(scene.to_mesh(), spacing)


if __name__ == "__main__":
    import sys

    print(read_3mf(sys.argv[1]))
