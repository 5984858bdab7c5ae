"""Workspaces, cells and clouds as obstacles of arms, against FCL."""

from collections import Counter

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED, Grid, Robot, Workspace
from cspace._bodies.solids import Part
from cspace._shapes import Voxels
from cspace._shapes.mesh import Mesh
from cspace.arms import Arm, PosedShape, build_arm_space
from cspace.errors import ConfigurationError, InputError, UnitWarning
from tests.helpers.arm_oracle import ArmOracle, sample_configurations
from tests.helpers.solids import ball, box
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import (
    joint,
    link,
    planar_arm,
    pose_at,
    posed_box,
    random_arm,
    write_urdf,
)

H = 0.2
LOWER = (-1.0, -1.0, -1.0)


def make_cell_boxes(cells, pose):
    """Return cells of side H for FCL, moved by a pose."""
    turn = pose[:3, :3]
    centers = (np.argwhere(cells) + 0.5) * H + LOWER
    return [box((H, H, H), turn @ center + pose[:3, 3], turn) for center in centers]


@pytest.mark.parametrize("kind", ["grid", "rotated cells", "moved arm", "cloud", "points"])
@given(seed=seeds)
@examples(6)
def test_workspaces_and_clouds_agree_with_fcl(tmp_path_factory, kind, seed):
    """FREE is compared with outer cells, BLOCKED with inner cells, points with themselves."""
    rng = np.random.default_rng(seed)
    path = random_arm(tmp_path_factory.mktemp("arm"), seed % 8)
    arm = Arm.from_urdf(path)
    outer = rng.random((10, 10, 10)) < 0.03
    inner = outer
    pose = pose_at(0.1, 0.2, -0.1, (0.3, -0.7, 1.1))
    base_pose = None
    obstacle = PosedShape(Voxels.of(outer, H, LOWER), pose)
    if kind == "grid":
        inner = outer & (rng.random(outer.shape) < 0.5)
        pose = np.eye(4)
        obstacle = Workspace.from_array(outer, H, LOWER, inner=inner)
    elif kind == "moved arm":
        obstacle = Voxels.of(outer, H, LOWER)
        base_pose = np.linalg.inv(pose)
    solids = [make_cell_boxes(cells, pose) for cells in (outer, inner)]
    if kind in ("cloud", "points"):
        radius = 0.05 if kind == "cloud" else 0.0
        points = rng.uniform(-1.0, 1.0, (60, 3))
        obstacle = Workspace.from_points(points, 0.5, radius=radius)
        solids = [[ball(max(radius, 1e-9), point) for point in points]] * 2
    names = [each.name for each in arm.links]
    pairs = [(a, b) for a in names for b in names if a < b] + [("l0", "still")]
    try:
        space = build_arm_space(
            {"still": obstacle}, arm, allowed_collisions=pairs, base_pose=base_pose
        )
    except ConfigurationError:
        assume(False)
    around, within = (ArmOracle(path, arm, {"still": each}, pairs) for each in solids)
    for q in sample_configurations(arm, rng, 15):
        apart = around.apart(q)
        state = space.classify(q)
        assert (state == FREE) == (apart > 1e-6)
        assert state != BLOCKED or within.apart(q) == 0.0
        if state == FREE:
            distance = space.obstacle_distance(q)
            assert distance == pytest.approx(apart, rel=0.05, abs=1e-6)
            assert distance <= apart + 1e-6
            q1 = np.clip(q + rng.normal(scale=0.4, size=q.shape), arm.lower, arm.upper)
            if space.motion_is_free(q, q1):
                assert all(around.apart(q + t * (q1 - q)) > 0.0 for t in np.linspace(0, 1, 20))


def make_cells(width, inner=True):
    """Return a cube of cells around (5, 0, 0)."""
    cells = np.zeros((40, 40, 40), dtype=bool)
    block = slice(20 - width // 2, 20 - width // 2 + width)
    cells[block, block, block] = True
    lower = (5 - 20.5 * 0.1, -20.5 * 0.1, -20.5 * 0.1)
    return Workspace.from_array(cells, 0.1, lower, inner=cells if inner else np.zeros_like(cells))


def make_diagonal():
    """Return cells that only edges connect, so that a link contains some of a larger part."""
    cells = np.zeros((40, 40, 40), dtype=bool)
    cells[range(40), range(40), 20] = True
    return Workspace.from_array(cells, 0.1, (3.0, -2.0, -2.0))


@pytest.mark.parametrize(
    "size, obstacle, state",
    [
        (2.0, make_cells(1), BLOCKED),
        (0.1, make_cells(20), BLOCKED),
        (2.0, make_cells(1, inner=False), MIXED),
        (2.0, make_diagonal(), BLOCKED),
        (2.0, posed_box((0.1,) * 3, 5, 0), BLOCKED),
        (0.1, posed_box((2.0,) * 3, 5, 0), BLOCKED),
    ],
    ids=["cell", "cells around", "outer cell", "diagonal", "box", "box around"],
)
def test_containment_is_never_free(tmp_path, size, obstacle, state):
    tip = link("tip", ((size,) * 3, (5, 0, 0)))
    path = write_urdf(tmp_path, link("base"), tip, joint("turn", "base", "tip"))
    space = build_arm_space({"thing": obstacle}, Arm.from_urdf(path))
    assert space.classify((0.0,)) == state
    assert space.obstacle_distance((0.0,)) == 0.0
    assert space.is_free((1.5,))
    assert not space.motion_is_free((0.0,), (1e-3,))


@pytest.fixture(scope="module")
def arm():
    """Read the planar arm of two links of 1 m."""
    return planar_arm()


def test_obstacles_in_millimetres_are_warned_of(arm):
    table = Robot.box((500.0, 500.0, 20.0), center=(800.0, 0.0, 0.0))
    with pytest.warns(UnitWarning, match="'table' is .* m away from the base"):
        space = build_arm_space({"table": table}, arm)
    with pytest.warns(UnitWarning, match="'post' is"):
        space.add_obstacle("post", table)
    box = Robot.box((200.0, 200.0, 200.0), center=(0.0, 0.0, -101.0))
    with pytest.warns(UnitWarning, match="'box' is 200 m x 200 m x 200 m large"):
        build_arm_space({"box": box}, arm)
    pose = np.eye(4)
    pose[0, 3] = 800.0
    with pytest.warns(UnitWarning, match="'box' is"):
        build_arm_space({"box": Robot.box((1.0, 1.0, 0.1))}, arm, base_pose=pose)


def test_unknown_cells_are_obstacles_that_prove_no_collision(arm):
    cells, unknown = np.zeros((2, 20, 20, 20), dtype=bool)
    cells[13:15] = True
    unknown[13] = True
    grid = Grid((0.0, -1.0, -1.0), 0.1, cells.shape)
    space = build_arm_space(Workspace(grid, cells, cells, unknown=unknown), arm)
    # The arm reaches the layers of x from 1.3 to 1.4 m, and to 1.5 m.
    points = [(0.0, 2.9), (0.0, np.arccos(0.34)), (0.0, 0.5)]
    assert space.classify(points).tolist() == [FREE, MIXED, BLOCKED]


def test_workspaces_are_copied_and_lazy_ones_are_read(arm, tmp_path):
    cells = np.zeros((20, 20, 20), dtype=bool)
    cells[14] = True
    lower = (0.0, -1.0, -1.0)
    np.save(tmp_path / "cells.npy", cells)
    lazy = Workspace.from_array(tmp_path / "cells.npy", 0.1, lower, lazy=True)
    live = Workspace(Grid(lower, 0.1, cells.shape), cells, cells)
    for workspace in (lazy, live):
        space = build_arm_space(workspace, arm)
        cells[:] = False
        assert space.classify(((0.0, 2.9), (0.0, 0.5))).tolist() == [FREE, BLOCKED]
        cells[14] = True


def test_scattered_cells_refuse_to_exceed_the_memory(arm, monkeypatch):
    """Slabs of as many cells need far fewer boxes."""
    rows = np.indices((24, 24, 24))
    away = pose_at(9.0, 9.0, 9.0)
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: 6_000_000)
    build_arm_space(Workspace.from_array(rows[0] % 2 == 0, 0.1), arm, base_pose=away)
    with pytest.raises(InputError, match=r"24 x 24 x 24 cells .* needs about"):
        scattered = Workspace.from_array(rows.sum(axis=0) % 2 == 0, 0.1)
        build_arm_space(scattered, arm, base_pose=away)


@examples(25)
@given(angles=st.tuples(*[st.floats(-3, 3)] * 3), at=st.tuples(*[st.floats(-5, 5)] * 3), seed=seeds)
def test_surfaces_of_posed_soups_stay_closed_to_the_last_bit(angles, at, seed):
    """Each triangle has corners of its own, as in STL files; an open body and a cavity are added."""
    outer, cavity, sheet = (trimesh.creation.icosphere(1, radius) for radius in (1.0, 0.5, 0.2))
    cavity.invert()
    triangles = np.concatenate([outer.triangles, cavity.triangles, sheet.triangles[:9] + 3.0])
    soup = np.random.default_rng(seed).permutation(triangles).reshape(-1, 3)
    mesh = Mesh(soup, np.arange(len(soup)).reshape(-1, 3), source="soup")
    corners, windings = Part(mesh, pose_at(*at, rotvec=angles)).surface
    assert len(corners) == len(outer.faces) + len(cavity.faces)
    edges = Counter[tuple[float, ...]]()
    for (a, b, c), winding in zip(corners.tolist(), windings.tolist(), strict=True):
        for first, last in ((a, b), (b, c), (c, a)):
            edges[*first, *last] += winding
            edges[*last, *first] -= winding
    assert not any(edges.values())


@pytest.mark.parametrize("turn", [0.0, 1.1])
def test_obstacles_and_what_else_a_space_hands_out_goes_in_again(turn):
    base_pose = pose_at(5.0, 0.5, 0.2, (0.0, 0.3 * turn, turn))
    arm = planar_arm()
    cells = np.zeros((4, 4, 4), dtype=bool)
    cells[1, 2] = True
    corner = (base_pose @ (0.5, 1.0, -0.2, 1.0))[:3]
    space = build_arm_space(
        {"cells": Workspace.from_array(cells, H, corner)},
        arm,
        base_pose=base_pose,
        margin=0.01,
        padding={"cells": 0.02},
        allowed_collisions=[("upper", "fore")],
    )
    space.add_obstacle("box", Robot.box((0.3, 0.2, 0.4)), base_pose @ pose_at(1.2, -0.8))
    again = build_arm_space(
        space.obstacles,
        space.arm,
        base_pose=base_pose,
        margin=space.margin,
        padding=space.padding,
        allowed_collisions=space.allowed_collisions,
    )
    q = np.random.default_rng(3).uniform(-3.0, 3.0, (2000, 2))
    states = space.classify(q)
    assert set(states.tolist()) >= {FREE, BLOCKED}
    np.testing.assert_array_equal(again.classify(q), states)
    for name, placed in again.obstacles.items():
        again.add_obstacle(name, placed)
    np.testing.assert_array_equal(again.classify(q), states)
    # The pose that the arm hands out is that of the box it carries.
    again.attach("box", link="fore", q=(0.0, 0.0))
    again.detach("box", (0.0, 0.0))
    np.testing.assert_allclose(again.obstacles["box"].pose, space.obstacles["box"].pose, atol=1e-12)
