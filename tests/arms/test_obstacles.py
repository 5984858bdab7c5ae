"""Workspaces, cells and clouds as obstacles of arms, against FCL."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import BLOCKED, FREE, MIXED, Grid, Robot, Workspace
from cspace.arms import Arm, ArmSpace, PosedShape, build_arm_space
from cspace.errors import InputError
from cspace.shapes import Mesh, Voxels
from tests.helpers.refusals import refusals
from tests.helpers.solids import ArmOracle, ball, box, sample_configurations
from tests.helpers.urdfs import joint, link, planar, pose_at, random_arm, write_urdf

H = 0.2
SIDE = 10
LOWER = (-1.0, -1.0, -1.0)


def make_cell_boxes(cells: Any, pose: Any = None) -> list[Any]:
    pose = np.eye(4) if pose is None else pose
    turn, centers = pose[:3, :3], (np.argwhere(cells) + 0.5) * H + LOWER
    return [box((H, H, H), turn @ center + pose[:3, 3], turn) for center in centers]


def list_allowed_pairs(arm: Arm, name: str) -> list[tuple[str, str]]:
    """Return all pairs of links, and one with ``name``."""
    names = [each.name for each in arm.links]
    return [*((one, other) for one in names for other in names if one < other), (names[0], name)]


def make_oracle(path: Path, arm: Arm, still: list[Any]) -> ArmOracle:
    return ArmOracle(path, arm, {"still": still}, list_allowed_pairs(arm, "still"))


def build_without_self_collisions(
    obstacles: Any, arm: Arm, name: str = "workspace", base_pose: Any = None
) -> ArmSpace:
    return build_arm_space(
        obstacles, arm, allowed_collisions=list_allowed_pairs(arm, name), base_pose=base_pose
    )


@pytest.mark.parametrize("seed", range(3))
def test_grids_agree_with_fcl(tmp_path: Path, seed: int) -> None:
    """Compare FREE with outer cells, and BLOCKED with inner cells."""
    path, rng = random_arm(tmp_path, seed), np.random.default_rng(seed)
    arm = Arm.from_urdf(path)
    outer = rng.random((SIDE,) * 3) < 0.03
    inner = outer & (rng.random(outer.shape) < 0.5)
    space = build_without_self_collisions(Workspace.from_array(outer, H, LOWER, inner=inner), arm)
    around, within = (make_oracle(path, arm, make_cell_boxes(cells)) for cells in (outer, inner))
    points = sample_configurations(arm, rng, 40)
    states = np.asarray(space.classify(points))
    assert set(states.tolist()) >= {FREE, BLOCKED}
    for q, state in zip(points, states.tolist(), strict=True):
        apart = around.apart(q)
        assert (state == FREE) == (apart > 1e-6)
        assert state != BLOCKED or within.apart(q) == 0.0
        if state == FREE:
            assert space.obstacle_distance(q) == pytest.approx(apart, rel=0.05, abs=1e-6)
            assert space.obstacle_distance(q) <= apart + 1e-6
    starts = points[states == FREE][:8]
    goals = np.clip(starts + rng.normal(scale=0.4, size=starts.shape), arm.lower, arm.upper)
    proven = np.asarray(space.motion_is_free(starts, goals))
    for q0, q1, is_free in zip(starts, goals, proven, strict=True):
        smallest = min(around.apart(q0 + t * (q1 - q0)) for t in np.linspace(0.0, 1.0, 20))
        assert smallest > 0.0 or not is_free


@pytest.mark.parametrize("moved", ["obstacles", "arm"])
def test_rotated_cells_agree_with_fcl(tmp_path: Path, moved: str) -> None:
    path, rng = random_arm(tmp_path, 7), np.random.default_rng(7)
    arm = Arm.from_urdf(path)
    cells, pose = rng.random((SIDE,) * 3) < 0.03, pose_at(0.1, 0.2, -0.1, (0.3, -0.7, 1.1))
    shape = Voxels.of(cells, H, LOWER)
    if moved == "obstacles":
        space = build_without_self_collisions({"cells": PosedShape(shape, pose)}, arm, "cells")
    else:
        space = build_without_self_collisions(
            {"cells": shape}, arm, "cells", base_pose=np.linalg.inv(pose)
        )
    around = make_oracle(path, arm, make_cell_boxes(cells, pose))
    points = sample_configurations(arm, rng, 40)
    free = np.asarray(space.is_free(points))
    np.testing.assert_array_equal(free, [around.apart(q) > 1e-6 for q in points])
    np.testing.assert_array_equal(np.asarray(space.classify(points)) == BLOCKED, ~free)


@pytest.mark.parametrize("radius", [0.05, 0.0])
def test_clouds_agree_with_fcl(tmp_path: Path, radius: float) -> None:
    """Compare with the points themselves, not their cells."""
    path, rng = random_arm(tmp_path, 2), np.random.default_rng(2)
    arm = Arm.from_urdf(path)
    points = rng.uniform(-1.0, 1.0, (60, 3))
    space = build_without_self_collisions(Workspace.from_points(points, 0.5, radius=radius), arm)
    around = make_oracle(path, arm, [ball(max(radius, 1e-9), point) for point in points])
    for q in sample_configurations(arm, rng, 40):
        apart, state = around.apart(q), space.classify(q)
        assert (state == FREE) == (apart > 1e-6)
        assert state != BLOCKED or apart == 0.0
        if state == FREE:
            assert space.obstacle_distance(q) == pytest.approx(apart, rel=0.05, abs=1e-6)


def make_tip_arm(folder: Path, size: float) -> Arm:
    return Arm.from_urdf(
        write_urdf(
            folder,
            link("base"),
            link("tip", ((size,) * 3, (5, 0, 0))),
            joint("turn", "base", "tip"),
        )
    )


@pytest.mark.parametrize(("size", "width"), [(2.0, 1), (0.1, 20)])
def test_containment_is_blocked(tmp_path: Path, size: float, width: int) -> None:
    """Put a cell into a link, and a link into cells."""
    cells = np.zeros((40, 40, 40), dtype=bool)
    block = slice(20 - width // 2, 20 - width // 2 + width)
    cells[block, block, block] = True
    arm, lower = make_tip_arm(tmp_path, size), (5 - 20.5 * 0.1, -20.5 * 0.1, -20.5 * 0.1)
    space = build_arm_space(Workspace.from_array(cells, 0.1, lower), arm)
    assert space.classify((0.0,)) == BLOCKED
    assert space.obstacle_distance((0.0,)) == 0.0
    assert space.is_free((1.5,))
    assert not space.motion_is_free((0.0,), (1e-3,))
    outer = build_arm_space(
        Workspace.from_array(cells, 0.1, lower, inner=np.zeros_like(cells)), arm
    )
    assert outer.classify((0.0,)) == MIXED


def test_parts_larger_than_a_link_still_collide(tmp_path: Path) -> None:
    """Connect cells only by edges; a link contains some."""
    cells = np.zeros((40, 40, 40), dtype=bool)
    cells[range(40), range(40), 20] = True
    space = build_arm_space(
        Workspace.from_array(cells, 0.1, (3.0, -2.0, -2.0)), make_tip_arm(tmp_path, 2.0)
    )
    assert space.classify((0.0,)) == BLOCKED


def test_unknown_cells_are_mixed(tmp_path: Path) -> None:
    """Treat unknown cells as obstacles that prove no collision."""
    cells, unknown = np.zeros((2, 20, 20, 20), dtype=bool)
    cells[13:15, :, :], unknown[13, :, :] = True, True
    grid = Grid((0.0, -1.0, -1.0), 0.1, cells.shape)
    arm = Arm.from_urdf(planar(tmp_path))
    space = build_arm_space(Workspace(grid, cells, cells, unknown=unknown), arm)
    # The arm of two links of 1 m reaches the layers of x from 1.3 to 1.4 m, and to 1.5 m.
    assert space.is_free((0.0, 2.9))
    assert space.classify((0.0, np.arccos(0.34))) == MIXED
    assert space.classify((0.0, 0.5)) == BLOCKED
    contact = space.closest((0.0, 2.0))
    assert (contact.link, contact.other) in {("fore", "workspace"), ("upper", "workspace")}


def test_contacts_name_obstacles_of_all_kinds(tmp_path: Path) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    cells = np.zeros((3, 3, 3), dtype=bool)
    cells[1, 1, 1] = True
    many = {
        "cells": Workspace.from_array(cells, 0.1, (2.5, -0.15, -0.15)),
        "cloud": Workspace.from_points([(0.0, 2.5, 0.0)], 0.1),
        "mesh": Workspace.from_mesh(
            Robot.box((0.1, 0.1, 0.1), center=(-1.0, -2.0, 0.0)).shape.surface, 0.1
        ),
        "none": Workspace.from_array(np.zeros((2, 2, 2), dtype=bool), 1.0),
        "ball": Robot.ball(0.1, center=(-2.5, 0.0, 0.0)).shape,
    }
    space = build_arm_space(many, arm)
    for angle, name in ((0.0, "cells"), (np.pi / 2, "cloud"), (-2.0, "mesh"), (3.0, "ball")):
        assert space.closest((angle, 0.0)).other == name
    assert space.obstacle_distance((0.0, 0.0)) == pytest.approx(0.6, abs=1e-6)
    assert space.obstacle_distance((np.pi / 2, 0.0)) == pytest.approx(0.5, abs=1e-6)


def test_live_workspaces_are_copied(tmp_path: Path) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    cells = np.zeros((20, 20, 20), dtype=bool)
    cells[19] = True
    workspace = Workspace(Grid((0.6, -1.0, -1.0), 0.1, cells.shape), cells, cells, live=True)
    space = build_arm_space(workspace, arm)
    assert space.is_free((0.0, 0.0))
    assert space.classify((0.0, 0.0)) == FREE


def test_scattered_cells_refuse_to_exceed_the_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Refuse scattered cells, but accept an equal number in slabs."""
    arm = Arm.from_urdf(planar(tmp_path))
    scattered = np.indices((24, 24, 24)).sum(axis=0) % 2 == 0
    away = pose_at(9.0, 9.0, 9.0)
    monkeypatch.setattr("cspace.limits.free_bytes", lambda: 6_000_000)
    build_arm_space(
        Workspace.from_array(np.indices((24, 24, 24))[0] % 2 == 0, 0.1), arm, base_pose=away
    )
    with pytest.raises(InputError, match=r"needs about .* its cells are 6912 boxes"):
        build_arm_space(Workspace.from_array(scattered, 0.1), arm, base_pose=away)


def test_lazy_workspaces_are_read(tmp_path: Path) -> None:
    cells = np.zeros((20, 20, 20), dtype=bool)
    cells[14] = True
    np.save(tmp_path / "cells.npy", cells)
    lazy = Workspace.from_array(tmp_path / "cells.npy", 0.1, (0.0, -1.0, -1.0), lazy=True)
    space = build_arm_space(lazy, Arm.from_urdf(planar(tmp_path)))
    assert space.classify(((0.0, 2.9), (0.0, 0.5))).tolist() == [FREE, BLOCKED]


def test_trimesh_is_accepted_as_obstacle_and_attached_object(tmp_path: Path) -> None:
    """Compare with the Shape made from it."""
    arm, rng = Arm.from_urdf(planar(tmp_path)), np.random.default_rng(1)
    mesh, pose = trimesh.creation.icosphere(2, 0.4), pose_at(1.3, 0.9)
    moved = mesh.copy().apply_transform(pose)
    spaces = [
        build_arm_space({"ball": each}, arm)
        for each in (moved, Mesh.of(moved), PosedShape(mesh, pose))
    ]
    points = spaces[0].sample_free(None) * np.ones((1, 1)), rng.uniform(-3.0, 3.0, (200, 2))
    states = [np.asarray(space.classify(np.concatenate(points))) for space in spaces]
    assert set(states[0].tolist()) >= {FREE, BLOCKED}
    assert (states[0] == states[1]).all() and (states[0] == states[2]).all()
    held = [
        arm.attach("tool", each, "fore", pose).links[-1].parts[0] for each in (mesh, Mesh.of(mesh))
    ]
    np.testing.assert_array_equal(held[0].hulls.corners, held[1].hulls.corners)
    for wrong, message in (
        (None, "shape is a NoneType"),
        (Robot.disc(0.1).shape, "shape is in the plane"),
    ):
        with pytest.raises(InputError, match=message):
            arm.attach("tool", wrong, "fore")


@refusals(
    "obstacles, message",
    (
        lambda: Workspace.from_array(np.ones((2, 2), dtype=bool), 1.0),
        "hold 'workspace', a map of the plane",
    ),
    (lambda: {"disc": Robot.disc(1.0).shape}, "hold 'disc', a shape of the plane"),
    (lambda: {"foot": Robot.ball(1.0).shape}, "name one 'foot'; a link has that name"),
    (lambda: {"cat": "meow"}, "hold 'cat', a str: shape is 'meow'"),
    (lambda: {"dog": 3}, "hold 'dog', a int: shape is a int; a polygon or a mesh is needed"),
    (
        lambda: {"bent": PosedShape(Robot.ball(1.0).shape, 2.0 * np.eye(4))},
        "pose of bent has shape",
    ),
    (lambda: [Robot.ball(1.0).shape], "obstacles is a list"),
)
def test_build_arm_space_refuses_invalid_obstacles(
    tmp_path: Path, obstacles: Any, message: str
) -> None:
    arm = Arm.from_urdf(planar(tmp_path))
    with pytest.raises(InputError, match=message):
        build_arm_space(obstacles(), arm)


@settings(max_examples=40)
@given(
    angles=st.tuples(*[st.floats(-3, 3)] * 3),
    at=st.tuples(*[st.floats(-5, 5)] * 3),
    seed=st.integers(0, 2**20),
)
def test_surfaces_of_posed_soups_stay_closed_to_the_last_bit(
    angles: Any, at: Any, seed: int
) -> None:
    """Give each triangle corners of its own, in random order, as STL files do; add an open body and
    a cavity."""
    rng = np.random.default_rng(seed)
    outer, cavity, sheet = (trimesh.creation.icosphere(2, radius) for radius in (1.0, 0.5, 0.2))
    cavity.invert()
    triangles = np.concatenate([outer.triangles, cavity.triangles, sheet.triangles[:9] + 3.0])
    soup = rng.permutation(triangles)
    mesh = Mesh(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3), source="soup")
    pose = pose_at(*at, rotvec=angles)
    corners, windings = PosedShape(mesh, pose).surface
    assert len(corners) == len(outer.faces) + len(cavity.faces)
    edges = Counter[tuple[float, ...]]()
    for triangle, winding in zip(corners.tolist(), windings.tolist(), strict=True):
        for one, other in zip(triangle, triangle[1:] + triangle[:1], strict=True):
            edges[*one, *other] += winding
            edges[*other, *one] -= winding
    assert not any(edges.values())
    back = (corners - pose[:3, 3]) @ pose[:3, :3]
    volume = (np.einsum("ij,ij->i", np.cross(back[:, 0], back[:, 1]), back[:, 2]) @ windings) / 6.0
    assert volume == pytest.approx(outer.volume + cavity.volume)
