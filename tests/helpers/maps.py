"""Maps of every kind to save, and checks of opened maps."""

import numpy as np
import pytest
import shapely
import trimesh

import cspace
from cspace import make_mesh
from cspace._shapes import Balls
from cspace.errors import FileError
from tests.helpers.handmade import fill_boxes
from tests.helpers.placements import draw_configurations

MAP_SUFFIXES = [".zarr", ""]

MOVINGAI_MAPS = [
    *("AR0011SR", "Berlin_1_1024", "arena", "brc504d", "maze512-32-0", "random512-10-0"),
]


def read_problems(path):
    """Return the map, starts, goals and published lengths of a benchmark of MovingAI.

    The map is refined, because the grid cannot decide a corridor one cell wide.
    """
    outer = cspace.Workspace.open(path).outer
    fine = np.repeat(np.repeat(outer, 3, axis=0), 3, axis=1)
    space = cspace.build(cspace.Workspace.from_array(fine, 1 / 3), cspace.Robot.disc(0.01))
    problems = path.with_suffix(".map.scen").read_text().splitlines()[1:]
    numbers = np.array([line.split()[-5:] for line in problems], dtype=float)
    ends, optimal = numbers[:, :4].reshape(-1, 2, 2), numbers[:, 4]
    ends[..., 1] = outer.shape[1] - 1 - ends[..., 1]
    return space, ends[:, 0] + 0.5, ends[:, 1] + 0.5, optimal


def same(a, b):
    """Fail unless two maps are equal and give equal answers."""
    one, two = a.to_xarray(), b.to_xarray()
    assert one.identical(two)
    assert all(one[name].dtype == two[name].dtype for name in one.variables)
    assert (a.grid, a.robot.spec, a.robot.name, a.rotations) == (
        b.grid,
        b.robot.spec,
        b.robot.name,
        b.rotations,
    )
    assert (a.workspace.inner is a.workspace.outer) == (b.workspace.inner is b.workspace.outer)
    q = draw_configurations(a, np.random.default_rng(0), 64)
    np.testing.assert_array_equal(a.classify(q), b.classify(q))


def proven_paths(space, q0, q1):
    """Return True for a proven path, False for proven disconnection, else None.

    For batches the result is an object array.
    """
    connected, disconnected = space.is_connected(q0, q1), space.is_disconnected(q0, q1)
    if isinstance(connected, bool):
        assert isinstance(disconnected, bool) and not (connected and disconnected)
        return True if connected else False if disconnected else None
    assert (
        connected.dtype == disconnected.dtype == np.bool_ and not (connected & disconnected).any()
    )
    return np.array([None, False, True], dtype=object)[2 * connected + disconnected]


def files(path):
    return (entry for entry in sorted(path.rglob("*")) if entry.is_file())


def refused(path, *texts):
    """Fail unless opening ``path`` raises FileError with the path and ``texts``."""
    with pytest.raises(FileError) as caught:
        cspace.open(path)
    message = str(caught.value)
    for text in (str(path), *texts):
        assert text in message


def plane():
    """Build a room of shapes with overlap counts."""
    room = shapely.box(0, 0, 4, 3) - shapely.box(0.31, 0.32, 3.7, 2.68)
    workspace = cspace.Workspace.from_polygons([room, shapely.Point(2, 1.5).buffer(0.4)], 0.1)
    return cspace.build(workspace, cspace.Robot.disc(0.2), counts=True, margin=0.03)


def grid():
    """Build a map from a bitmap with a free exterior, without shapes."""
    workspace = cspace.Workspace.from_array(np.eye(9, 7, dtype=bool), 0.1, lower=(-0.3, 0.7))
    return cspace.build(workspace, cspace.Robot.rectangle(0.25, 0.15), outside="free")


def turning():
    """Build a map with rotation cells of different widths."""
    workspace = cspace.Workspace.from_array(np.eye(12, 9, dtype=bool), 0.1)
    borders = [-1.0, 0.3, 1.1, 2.0, 4.0, 2.0 * np.pi - 1.0]
    robot = cspace.Robot.polygon([(0, 0), (0.4, 0), (0, 0.2)])
    return cspace.build(workspace, robot, rotations=borders, counts=True)


def symmetric():
    """Build a map whose rotation cells share slices in pairs."""
    workspace = cspace.Workspace.from_polygons(shapely.box(0, 0, 1, 1), 0.1, (-1, -1, 2, 2))
    return cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.2), rotations=8)


def solid():
    """Build a map of meshes and balls in space."""
    housing = make_mesh(trimesh.creation.box((0.6, 0.5, 0.4)))
    base = cspace.Workspace.from_mesh(housing, 0.1, (-1.0, -0.9, -0.8, 1.0, 0.9, 0.8))
    shapes = (
        Balls.of([(0.5, 0.5, 0.5)], 0.2),
        housing,
        Balls.of([(-0.8, 0.0, 0.1), (0.0, 0.0, 0.7)], [0.0, 0.1]),
    )
    workspace = cspace.Workspace(
        base.grid, base.outer, base.inner, source=base.source, shapes=shapes
    )
    return cspace.build(workspace, cspace.Robot.box((0.3, 0.2, 0.1)), counts=True, margin=0.03)


def solid_free():
    """Build a map of a freely rotating, symmetric robot."""
    workspace = cspace.Workspace.from_array(fill_boxes((7, 6, 5), np.s_[3, 3]), 0.1)
    return cspace.build(
        workspace, cspace.Robot.box((0.2, 0.1, 0.1)), rotations=cspace.Rotations.quaternions(2)
    )


MAP_BUILDERS = {
    make.__name__: make for make in (plane, grid, turning, symmetric, solid, solid_free)
}
