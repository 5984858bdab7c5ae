"""Bounds of motions, and motions of links and tools past balls and walls."""

import numpy as np
import pytest
import trimesh

import cspace
from cspace import Robot
from cspace._bodies.chain import motion_bounds
from tests.helpers.strategies import few
from tests.helpers.urdfs import (
    joint,
    link,
    pose_at,
    posed_box,
    random_arm,
    write_slider,
    write_urdf,
)


def write_chain(folder, last):
    """Write three links of 1 m."""
    bar = ((1.0, 0.0001, 0.0001), (0.5, 0, 0))
    axis = {"prismatic": (0, 1, 0), "revolute": (0, 0, 1)}[last]
    return write_urdf(
        folder,
        *(link(name, bar) for name in "abc"),
        joint("one", "a", "b", at=(1, 0, 0)),
        joint("two", "b", "c", at=(1, 0, 0), axis=axis, kind=last),
    )


@pytest.mark.parametrize(
    "make, start, end",
    [
        (lambda folder: write_chain(folder, "revolute"), (-0.01, -0.01), (0.01, 0.01)),
        (lambda folder: write_chain(folder, "prismatic"), (-0.01, -1.0), (0.01, 1.0)),
        (lambda folder: random_arm(folder, 0), None, None),
    ],
    ids=["turns", "slides", "random"],
)
def test_motion_bounds_agree_with_differences(tmp_path, make, start, end):
    """Compare bounds of link pairs with motions of corners.

    The bounds are nearly sharp: in a row of links rotating in one sense, the end of the last link
    reaches the largest acceleration.
    """
    arm = cspace.Arm.from_urdf(make(tmp_path))
    rng = np.random.default_rng(5)
    lower = np.maximum(arm.lower, -2.0)
    upper = np.minimum(arm.upper, 2.0)
    q0, q1 = (lower, upper) if start is None else (np.array(start), np.array(end))
    times = np.linspace(0.0, 1.0, 101)
    poses = [arm.poses(q0 + t * (q1 - q0)) for t in times]
    nearest = 0.0
    for one in arm.links:
        corners = np.concatenate([part.boundary.simplices.reshape(-1, 3) for part in one.parts])
        corners = np.c_[corners, np.ones(len(corners))][rng.permutation(len(corners))[:20]]
        radius = max(
            float(np.linalg.norm(part.boundary.simplices, axis=-1).max()) for part in one.parts
        )
        for other in arm.links:
            if one.body == other.body:
                continue
            far, curvature_bound, _ = motion_bounds(arm.chain, one.body, other.body, radius, q0, q1)
            seen = np.stack(
                [
                    (corners @ (np.linalg.inv(each[other.name]) @ each[one.name]).T)[:, :3]
                    for each in poses
                ]
            )
            speed = np.linalg.norm(np.diff(seen, axis=0), axis=-1).max() * 100
            bent = np.linalg.norm(np.diff(seen, n=2, axis=0), axis=-1).max() * 100**2
            assert speed <= far * (1 + 1e-6)
            assert bent <= 2.0 * curvature_bound * (1 + 1e-6) + 1e-9
            nearest = max(nearest, bent / (2.0 * curvature_bound + 1e-9))
    assert start is None or nearest > 0.9


TOOLS = [
    trimesh.creation.annulus(0.1, 0.2, 0.1, sections=40),
    trimesh.creation.icosphere(subdivisions=3, radius=0.2),
    trimesh.creation.torus(0.3, 0.1, major_sections=24, minor_sections=12),
]


@pytest.mark.parametrize("rounds", few([50, 160]))
@pytest.mark.parametrize("seed", range(3))
def test_long_motions_never_miss_a_ball(tmp_path, seed, rounds):
    """Place a ball on the course of a point of a link, or of a tool with many triangles."""
    arm = cspace.Arm.from_urdf(random_arm(tmp_path, seed)).attach("tool", TOOLS[seed], "l4")
    rng = np.random.default_rng(seed)
    lower = np.maximum(arm.lower, -3.0)
    upper = np.minimum(arm.upper, 3.0)
    names = [each.name for each in arm.links]
    touch = [("l0", "seed"), *((a, b) for a in names for b in names if a < b)]
    for k in range(rounds):
        each = arm.links[-1] if k % 2 else arm.links[1 + k % 4]
        triangles = np.concatenate([part.boundary.simplices for part in each.parts])
        point = rng.dirichlet((0.3, 0.3, 0.3)) @ triangles[rng.integers(len(triangles))]
        q0, q1 = np.where(rng.random((2, arm.dof)) < 0.5, lower, upper)
        if k % 3 == 0:
            q1 = np.where(np.arange(arm.dof) == rng.integers(arm.dof), q1, q0)
        t = rng.uniform()
        pose = arm.poses(q0 + t * (q1 - q0))[each.name]
        there = pose[:3, :3] @ point + pose[:3, 3]
        ball = cspace.arms.PosedShape(Robot.ball(1e-4).shape, pose_at(*there))
        space = cspace.build_arm_space({"seed": ball}, arm, allowed_collisions=touch)
        assert not space.motion_is_free(q0, q1)


def test_swing_past_a_wall_is_decided_to_a_micrometre(tmp_path):
    """Rotate a bar past a wall; solve the distance by hand."""
    path = write_urdf(
        tmp_path,
        link("base"),
        link("arm", ((1.0, 0.02, 0.02), (0.5, 0, 0))),
        link("tip", ((0.02, 0.02, 0.02), (0, 0, 0.1))),
        joint("turn", "base", "arm"),
        joint("more", "arm", "tip", at=(0.5, 0, 0), axis=(1, 0, 0), limits=(-0.1, 0.1)),
    )
    arm = cspace.Arm.from_urdf(path)
    far = float(np.hypot(1.0, 0.01))
    for gap, is_free in ((1e-6, True), (-1e-6, False)):
        space = cspace.build_arm_space(
            {"wall": posed_box((0.1, 4.0, 1.0), far + gap + 0.05, 0.0)}, arm
        )
        assert space.motion_is_free((-1.0, 0.0), (1.0, 0.05)) is is_free


def test_many_turns_prove_nothing_below_their_rounding(tmp_path):
    """Test 10^9 turns, whose rounding is 1e-7 rad."""
    bar = link("arm", ((1.0, 0.02, 0.02), (0.5, 0, 0)))
    arm = cspace.Arm.from_urdf(
        write_urdf(
            tmp_path,
            link("base"),
            bar,
            joint("turn", "base", "arm", kind="continuous", limits=None),
        )
    )
    space = cspace.build_arm_space(
        {"wall": posed_box((0.4, 0.1, 1.0), 0.5, 0.01 + 1e-8 + 0.05)}, arm
    )
    assert space.is_free((0.0,))
    assert not space.is_free((2e9 * np.pi,))


def fold_sheet():
    """Fold a sheet in the shape of an L, without a thickness."""
    sheet = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0)]
    upper = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    lower = [(3, 1, 0), (3, 2, 1), (5, 3, 0), (5, 4, 3)]
    return trimesh.Trimesh(0.5 * np.array(sheet), upper + lower, process=False)


CONVEX = trimesh.convex.convex_hull(np.random.default_rng(0).normal(0.0, 0.4, (60, 3)))

SOLIDS = {
    "cylinder": trimesh.creation.cylinder(0.3, 0.8, sections=64),
    "convex": CONVEX,
    "inward": trimesh.Trimesh(CONVEX.vertices, CONVEX.faces[:, ::-1], process=False),
    "folded": fold_sheet(),
    "pierced": TOOLS[0],
}


@pytest.mark.filterwarnings("ignore:the windings of")
@pytest.mark.parametrize("name", SOLIDS)
def test_distances_of_meshes_agree_with_their_triangles(tmp_path, name):
    """Compare distances of a cube of 2 mm with those of its center from all triangles."""
    mesh = SOLIDS[name]
    arm = cspace.Arm.from_urdf(write_slider(tmp_path, ((0.002,) * 3, (0, 0, 0)), "xyz"))
    pose = pose_at(0.1, -0.2, 0.3, (0.4, 1.0, -0.3))
    obstacle = cspace.arms.PosedShape(mesh, pose)
    space = cspace.build_arm_space({"thing": obstacle}, arm)
    points = np.random.default_rng(1).uniform(-0.8, 0.8, (400, 3))
    _, distances, _ = trimesh.proximity.closest_point(mesh, points)
    q = points @ pose[:3, :3].T + pose[:3, 3]
    is_inside = mesh.contains(points) if name != "folded" else np.zeros(len(q), dtype=bool)
    is_near = distances < 0.002
    assert not space.is_free(q[is_inside]).any()
    found = space.obstacle_distance(q[~is_inside & ~is_near])
    expected = distances[~is_inside & ~is_near]
    assert (found < expected).all()
    assert (found > expected - 0.0018).all()


@pytest.mark.filterwarnings("ignore:.*units are metres")
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_slides_are_decided_alike_in_any_unit(tmp_path, unit):
    size = (unit, unit, unit)
    path = write_slider(tmp_path, (size, (0, 0, 0)), limits=(-10 * unit, 10 * unit))
    walls = {"wall": posed_box(size, 3 * unit, 0.0)}
    space = cspace.build_arm_space(walls, cspace.Arm.from_urdf(path))
    for gap, is_free in ((1e-9, True), (-1e-9, False)):
        q = np.array([(2 - gap) * unit, 0.0])
        assert space.motion_is_free(q, q) == is_free
