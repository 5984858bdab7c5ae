"""Trees of hulls and bounds of motions, against samples."""

import numpy as np
import pytest
import trimesh

from cspace import Robot
from cspace.arms import Arm, PosedShape, build_arm_space
from cspace.arms.chain import motion_bounds
from cspace.bodies.hulls import MAX_TRIANGLES_PER_TILE, node_corners
from cspace.shapes import Mesh
from tests.helpers.urdfs import joint, link, pose_at, posed_box, random_arm, write_urdf

ROTATION = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
POSE = np.vstack([np.c_[ROTATION, (0.3, -0.2, 0.1)], [0, 0, 0, 1]])


def to_mesh(made):
    return Mesh(made.vertices, made.faces)


SHAPES = {
    "box": lambda: Robot.box((0.2, 0.3, 0.4)).shape,
    "cylinder": lambda: Robot.cylinder(0.1, 0.3).shape,
    "ball": lambda: Robot.ball(0.1).shape,
    "ring": lambda: to_mesh(trimesh.creation.annulus(0.1, 0.2, 0.1, sections=40)),
    "globe": lambda: to_mesh(trimesh.creation.icosphere(subdivisions=4, radius=0.2)),
    "flat": lambda: Mesh(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], [(0, 1, 2), (0, 2, 3)], solid="surface"
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_nodes_contain_their_descendants(name):
    """Check the box, ball and hull of each node."""
    part = PosedShape(SHAPES[name](), POSE).bounds_pair[0]
    boundary = part.boundary.simplices
    radius = part.boundary.radii.max()
    hulls = part.hulls
    assert (len(hulls.nodes) == 1) == (name in {"box", "cylinder", "ball"})
    directions = np.random.default_rng(1).normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    last = np.arange(1, len(hulls.nodes) + 1)
    for node in range(len(hulls.nodes))[::-1]:
        if hulls.nodes[node, 0]:
            last[node] = last[hulls.nodes[node, 0]]
    leaves = [k for k in range(len(hulls.nodes)) if hulls.nodes[k, 0] == 0]
    if len(leaves) > 1:
        held = np.array(sorted(node_corners(hulls, k)[0].ravel().tolist() for k in leaves))
        np.testing.assert_array_equal(held, sorted(boundary.reshape(-1, 9).tolist()))
    for node in range(0, len(hulls.nodes), 1 + len(hulls.nodes) // 200):
        below = [k for k in leaves if node <= k < last[node]]
        corners = (
            boundary.reshape(-1, 3)
            if len(leaves) == 1
            else np.concatenate([node_corners(hulls, k)[0] for k in below])
        )
        box = hulls.boxes[node]
        assert (np.abs(corners - box[:3]).max(axis=0) + radius <= box[3:6] + 1e-12).all()
        assert np.linalg.norm(corners - box[:3], axis=1).max() + radius <= box[6] + 1e-12
        hull, grown = node_corners(hulls, node)
        highest, bound = ((points @ directions.T).max(axis=0) for points in (corners, hull))
        assert (highest + radius <= bound + grown + 1e-12).all()
        assert len(below) <= MAX_TRIANGLES_PER_TILE or len(hull) < 400


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
    ("make", "start", "end"),
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
    arm = Arm.from_urdf(make(tmp_path))
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


@pytest.mark.parametrize("seed", range(3))
def test_long_motions_never_miss_a_ball(tmp_path, seed):
    """Place a ball on the course of a corner."""
    arm = Arm.from_urdf(random_arm(tmp_path, seed))
    rng = np.random.default_rng(seed)
    lower = np.maximum(arm.lower, -3.0)
    upper = np.minimum(arm.upper, 3.0)
    names = [each.name for each in arm.links]
    touch = [("l0", "seed"), *((a, b) for a in names for b in names if a < b)]
    for k in range(60):
        each = arm.links[1 + k % 4]
        corners = np.concatenate([part.boundary.simplices.reshape(-1, 3) for part in each.parts])
        q0, q1 = np.where(rng.random((2, arm.dof)) < 0.5, lower, upper)
        if k % 3 == 0:
            q1 = np.where(np.arange(arm.dof) == rng.integers(arm.dof), q1, q0)
        t = rng.uniform()
        pose = arm.poses(q0 + t * (q1 - q0))[each.name]
        there = pose[:3, :3] @ corners[rng.integers(len(corners))] + pose[:3, 3]
        space = build_arm_space(
            {"seed": PosedShape(Robot.ball(1e-4).shape, pose_at(*there))},
            arm,
            allowed_collisions=touch,
        )
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
    arm = Arm.from_urdf(path)
    far = float(np.hypot(1.0, 0.01))
    for gap, is_free in ((1e-6, True), (-1e-6, False)):
        space = build_arm_space({"wall": posed_box((0.1, 4.0, 1.0), far + gap + 0.05, 0.0)}, arm)
        assert space.motion_is_free((-1.0, 0.0), (1.0, 0.05)) is is_free


def test_many_turns_prove_nothing_below_their_rounding(tmp_path):
    """Test 10^9 turns, whose rounding is 1e-7 rad."""
    bar = link("arm", ((1.0, 0.02, 0.02), (0.5, 0, 0)))
    arm = Arm.from_urdf(
        write_urdf(tmp_path, link("base"), bar, joint("turn", "base", "arm", kind="continuous"))
    )
    space = build_arm_space({"wall": posed_box((0.4, 0.1, 1.0), 0.5, 0.01 + 1e-8 + 0.05)}, arm)
    assert space.is_free((0.0,))
    assert not space.is_free((2e9 * np.pi,))
