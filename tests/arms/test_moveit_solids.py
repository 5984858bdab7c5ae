"""Random planning scenes of MoveIt against solids that are sampled by other code."""

import json
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspace import Arm, build_arm_space
from cspace.arms import read_moveit_scene
from tests.helpers.urdfs import joint, link, pose_of, write_urdf

SIDE = 1e-3
"""Side of the probe, a cube at the origin of the link ``tip``, metres."""

LIMIT = 15.0
"""Limit of the joints x, y and z, metres."""


@pytest.fixture(scope="module")
def probe(tmp_path_factory):
    """Write a tiny cube that three joints slide, a flange beside it, and a stand at the base."""
    slides = {"kind": "prismatic", "limits": (-LIMIT, LIMIT)}
    path = write_urdf(
        tmp_path_factory.mktemp("probe"),
        *(link(name) for name in ("base", "stand", "beam", "cart", "flange")),
        link("tip", ((SIDE,) * 3, (0, 0, 0))),
        joint("mount", "base", "stand", at=(0.3, -1.2, 0.4), rpy=(0.5, -0.8, 1.9), kind="fixed"),
        joint("x", "base", "beam", at=(0.1, 0, 0), axis=(1, 0, 0), **slides),
        joint("y", "beam", "cart", at=(0, -0.2, 0), axis=(0, 1, 0), **slides),
        joint("z", "cart", "tip", at=(0, 0, 0.3), axis=(0, 0, 1), **slides),
        joint("wrist", "tip", "flange", at=(0.2, 0.1, -0.3), rpy=(-1.1, 0.4, 0.7), kind="fixed"),
    )
    return path, Arm.from_urdf(path)


def draw_pose(rng):
    """Draw a pose as a message and as a matrix."""
    turn = Rotation.random(random_state=int(rng.integers(2**31)))
    matrix = np.eye(4)
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = rng.uniform(-2.0, 2.0, 3)
    return {"position": matrix[:3, 3].tolist(), "orientation": turn.as_quat().tolist()}, matrix


def sample_solid(kind, sizes, rng):
    """Draw points of a box or a cone, shape (8, 3); half of them lie on its surface."""
    cube = rng.uniform(-1.0, 1.0, (8, 3))
    cube[:4] /= np.abs(cube[:4]).max(axis=1, keepdims=True)
    if kind == "box":
        return 0.5 * cube * sizes
    # Shrink the cross sections of the cube to the discs of the cone.
    square = cube[:, :2]
    widths = np.abs(square).max(axis=1, keepdims=True) / np.linalg.norm(
        square, axis=1, keepdims=True
    )
    height, radius = sizes
    along = cube[:, 2:]
    return np.hstack([square * widths * radius * 0.5 * (1.0 - along), 0.5 * height * along])


def draw_object(name, frame, rng):
    """Draw a collision object, and points of each of its solids in its frame."""
    place, whole = draw_pose(rng)
    solids, poses, samples = [], [], []
    for _ in range(rng.integers(1, 4)):
        kind = str(rng.choice(["box", "cone"]))
        sizes = rng.uniform(0.05, 1.0, 3 if kind == "box" else 2)
        pose_message, pose = draw_pose(rng)
        solids.append({"type": kind, "dimensions": sizes.tolist()})
        poses.append(pose_message)
        pose = whole @ pose
        samples.append(sample_solid(kind, sizes, rng) @ pose[:3, :3].T + pose[:3, 3])
    header = {"frame_id": frame}
    message = {"id": name, "header": header, "pose": place}
    return message | {"primitives": solids, "primitive_poses": poses}, samples


def draw_matrix(rng):
    """Draw an allowed collision matrix, and return it with the pairs that may touch."""
    names = rng.permutation(["tip", "mug", "flange", "a", "b"])[: rng.integers(6)].tolist()
    upper = np.triu(rng.random((len(names),) * 2) < 0.5)
    entries = upper | upper.T
    defaults = {name: bool(rng.integers(2)) for name in ("tip", "a") if rng.random() < 0.5}

    def may_touch(one, other):
        """Return True if the entry of a pair and the defaults of both allow it."""
        values = [defaults[name] for name in (one, other) if name in defaults]
        if one in names and other in names:
            values.append(entries[names.index(one), names.index(other)])
        return bool(values) and all(values)

    matrix = {"entry_names": names, "entry_values": entries.tolist()}
    matrix["default_entry_names"] = list(defaults)
    matrix["default_entry_values"] = list(defaults.values())
    return matrix, may_touch


@pytest.mark.filterwarnings("ignore:.*enlarge the robot", "ignore:.*units", "ignore:.*names b,")
@pytest.mark.parametrize("root", ["world", "base", "stand", "hall"])
@pytest.mark.parametrize("seed", range(4))
def test_points_in_solids_of_a_scene_are_never_free(tmp_path, probe, root, seed):
    path, arm = probe
    rng = np.random.default_rng([seed, len(root)])
    base_pose = draw_pose(rng)[1] if root == "hall" else None
    state = dict(zip("xyz", rng.uniform(-2.0, 2.0, 3).tolist(), strict=True))
    # Poses of frames in the frame of the base; those of links where the state has them.
    frames = {name: pose_of(path, name, state) for name in ("base", "stand", "tip", "flange")}
    frames["world"] = np.eye(4)
    frames["hall"] = np.eye(4) if base_pose is None else np.linalg.inv(base_pose)
    tip = frames["tip"][:3, 3]

    def place(points, frame):
        return points @ frames[frame][:3, :3].T + frames[frame][:3, 3]

    world, solids = [], []
    for name in ("a", "object 1"):
        message, samples = draw_object(name, root, rng)
        world.append(message)
        solids += [(name, place(points, root)) for points in samples]
    carried, grips = [], [("tip", np.zeros((1, 3)))]
    for name in ("mug", "cup")[: seed % 3]:
        carrier = str(rng.choice(["tip", "flange"]))
        frame = str(rng.choice([carrier, root]))
        message, samples = draw_object(name, frame, rng)
        carried.append({"link_name": carrier, "object": message})
        # The joints only slide, so that the tip keeps its rotation.
        grips += [(name, place(points, frame) - tip) for points in samples]
    matrix, may_touch = draw_matrix(rng)
    joint_state = {"name": list(state), "position": list(state.values())}
    robot_state = {"joint_state": joint_state, "attached_collision_objects": carried}
    scene = {"world": {"collision_objects": world}, "allowed_collision_matrix": matrix}
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(scene | {"robot_state": robot_state}))
    space = build_arm_space(read_moveit_scene(file), arm, base_pose=base_pose)
    assert (len(space.obstacles), len(space.arm.links)) == (len(solids), len(grips))
    home = pose_of(path, "tip", {})[:3, 3]
    for (grip, points), (name, obstacle_points) in product(grips, solids):
        if may_touch(grip, name):
            continue
        q = obstacle_points - home - points[rng.integers(len(points), size=len(obstacle_points))]
        q = q[(np.abs(q) <= LIMIT).all(axis=1)]
        assert not len(q) or not space.is_free(q).any()
    if not carried:
        assert space.is_free((LIMIT, LIMIT, LIMIT))
