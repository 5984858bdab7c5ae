"""Random planning scenes of MoveIt against solids that are sampled by other code."""

import json
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace import Arm, build_arm_space
from cspace.arms import read_moveit_scene
from tests.helpers.urdfs import joint, link, pose_of, write_urdf

SIDE = 1e-3
"""Side of the probe, a cube at the origin of the link ``tip``, metres."""

LIMIT = 15.0
"""Limit of the joints x, y and z, metres."""

TETRAHEDRON = np.array([(0.0, 0.0, 0.0), (0.5, 0.1, 0.0), (0.0, 0.6, 0.2), (0.1, 0.0, 0.7)])
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]


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


def sample_solid(kind, sizes, rng):
    """Draw points of a solid, shape (8, 3); half of them lie on its surface."""
    if kind == "mesh":
        return rng.dirichlet((1, 1, 1, 1), 8) @ TETRAHEDRON
    cube = rng.uniform(-1, 1, (8, 3))
    cube[:4] /= np.abs(cube[:4]).max(axis=1, keepdims=True)
    if kind == "box":
        return 0.5 * cube * sizes
    # Shrink cubes to balls, and squares to discs.
    count = 3 if kind == "sphere" else 2
    square = cube[:, :count]
    most = np.abs(square).max(axis=1, keepdims=True)
    round_points = square * most / np.linalg.norm(square, axis=1, keepdims=True)
    if kind == "sphere":
        return round_points * sizes[0]
    height, radius = sizes
    along = cube[:, 2:]
    width = 0.5 * (1 - along) if kind == "cone" else 1.0
    return np.hstack([round_points * radius * width, 0.5 * along * height])


class Part(NamedTuple):
    """A shape of an object, and its pose in the frame of the object's header."""

    kind: str
    sizes: tuple[float, ...]
    pose: np.ndarray

    def sample(self, frame_pose, rng):
        """Draw points, in the frame in which the pose of the header's frame is given."""
        pose = frame_pose @ self.pose
        return sample_solid(self.kind, self.sizes, rng) @ pose[:3, :3].T + pose[:3, 3]


class Case(NamedTuple):
    """A message, and what it means."""

    message: dict[str, Any]
    root: str
    base_pose: np.ndarray
    world: dict[str, list[Part]]
    attached: list[tuple[str, str, list[Part]]]
    state: dict[str, float]

    def may_touch(self, one, other):
        """Return True if the entry of a pair and the defaults of both allow it."""
        matrix = self.message["allowed_collision_matrix"]
        names = matrix["entry_names"]
        defaults = zip(matrix["default_entry_names"], matrix["default_entry_values"], strict=True)
        values = [value for name, value in defaults if name in (one, other)]
        if one in names and other in names:
            values.append(matrix["entry_values"][names.index(one)][names.index(other)])
        return bool(values) and all(values)


COORDINATES = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
LENGTHS = st.tuples(*[st.floats(0.05, 1.0)] * 3)


@st.composite
def poses(draw):
    """Draw a pose as a message, whose quaternion may have any length, and as a matrix."""
    turn = Rotation.from_rotvec(draw(COORDINATES))
    matrix = np.eye(4)
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = draw(COORDINATES)
    scale = draw(st.sampled_from([1.0, 1e-9, 3.0, 1e-160]))
    numbers = {"position": matrix[:3, 3].tolist(), "orientation": (scale * turn.as_quat()).tolist()}
    if draw(st.booleans()):
        named = {key: dict(zip("xyzw", row, strict=False)) for key, row in numbers.items()}
        return named, matrix
    return numbers, matrix


POSES = {"primitives": "primitive_poses", "meshes": "mesh_poses"}
PRIMITIVES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}
"""Number of dimensions by type; the types count from 1 in this order."""


@st.composite
def objects(draw, frame):
    """Draw a collision object without its id, and its shapes."""
    message = {"header": {"frame_id": frame}}
    whole = np.eye(4)
    if draw(st.booleans()):
        message["pose"], whole = draw(poses())
    parts = {"primitives": [], "meshes": []}
    kinds = st.sampled_from([*PRIMITIVES, "mesh"])
    for kind in draw(st.lists(kinds, min_size=1, max_size=3)):
        pose_message, pose = draw(poses())
        sizes = draw(LENGTHS)
        field = "meshes"
        shape = {"vertices": TETRAHEDRON.tolist(), "triangles": FACES}
        if kind != "mesh":
            field = "primitives"
            sizes = sizes[: PRIMITIVES[kind]]
            names = [kind, kind.upper(), 1 + list(PRIMITIVES).index(kind)]
            shape = {"type": draw(st.sampled_from(names)), "dimensions": list(sizes)}
        message.setdefault(field, []).append(shape)
        message.setdefault(POSES[field], []).append(pose_message)
        parts[field].append(Part(kind, sizes, whole @ pose))
    for field, poses_field in POSES.items():
        # A single shape needs no pose.
        if len(parts[field]) == 1 and draw(st.booleans()):
            del message[poses_field]
            parts[field] = [parts[field][0]._replace(pose=whole)]
    return message, [*parts["primitives"], *parts["meshes"]]


@st.composite
def cases(draw):
    """Draw a scene."""
    root = draw(st.sampled_from(["world", "base", "stand", "hall"]))
    base_pose = draw(poses())[1] if root == "hall" else np.eye(4)
    world = {}
    written = []
    for name in draw(st.sets(st.sampled_from(["a", "b", "object 1"]), min_size=1)):
        message, world[name] = draw(objects(root))
        written.append({"id": name} | message)
    attached = []
    carried = []
    for name in draw(st.sampled_from([[], ["mug"], ["mug", "cup"]])):
        carrier = draw(st.sampled_from(["tip", "flange"]))
        frame = draw(st.sampled_from([carrier, root]))
        message, parts = draw(objects(frame))
        carried.append({"link_name": carrier, "object": {"id": name} | message})
        attached.append((name, frame, parts))
    state = dict(zip("xyz", draw(COORDINATES), strict=True))
    known = draw(st.lists(st.sampled_from(["tip", "mug", "flange", "a", "b"]), unique=True))
    upper = np.triu(
        draw(st.lists(st.booleans(), min_size=25, max_size=25).map(np.array)).reshape(5, 5)
    )
    entries = (upper | upper.T)[: len(known), : len(known)]
    defaults = draw(
        st.dictionaries(st.sampled_from(["tip", "mug", "a"]), st.booleans(), max_size=3)
    )
    message = {
        "world": {"collision_objects": written},
        "allowed_collision_matrix": {
            "entry_names": known,
            "entry_values": entries.tolist(),
            "default_entry_names": list(defaults),
            "default_entry_values": list(defaults.values()),
        },
        "robot_state": {
            "joint_state": {"name": list(state), "position": list(state.values())},
            "attached_collision_objects": carried,
        },
    }
    return Case(message, root, base_pose, world, attached, state)


@pytest.mark.filterwarnings("ignore:.*enlarge the robot", "ignore:.*units")
@settings(
    max_examples=25,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    phases=set(Phase) - {Phase.explain},
)
@given(case=cases(), seed=st.integers(0, 2**20))
def test_points_in_solids_of_a_scene_are_never_free(tmp_path, probe, case, seed):
    path, arm = probe
    rng = np.random.default_rng(seed)
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(case.message))
    base_pose = case.base_pose if case.root == "hall" else None
    space = build_arm_space(read_moveit_scene(file), arm, base_pose=base_pose)
    assert len(space.obstacles) == sum(map(len, case.world.values()))
    assert len(space.arm.links) == 1 + sum(len(parts) for _, _, parts in case.attached)
    # Poses of frames in the frame of the base; those of links where the state has them.
    frames = {name: pose_of(path, name, case.state) for name in ("base", "stand", "tip", "flange")}
    frames |= {"world": np.eye(4), "hall": np.linalg.inv(case.base_pose)}
    solids = []
    for name, parts in case.world.items():
        solids += [(name, part.sample(frames[case.root], rng)) for part in parts]
    grips = [("tip", np.zeros((1, 3)))]
    for name, frame, parts in case.attached:
        # The joints only slide, so that the tip keeps its rotation.
        tip = frames["tip"][:3, 3]
        grips += [(name, part.sample(frames[frame], rng) - tip) for part in parts]
    home = pose_of(path, "tip", {})[:3, 3]
    for (grip, points), (name, obstacle_points) in product(grips, solids):
        if case.may_touch(grip, name):
            continue
        chosen = points[rng.integers(len(points), size=len(obstacle_points))]
        q = obstacle_points - home - chosen
        q = q[(np.abs(q) <= LIMIT).all(axis=1)]
        assert not len(q) or not space.is_free(q).any()
    if not case.attached:
        assert space.is_free((LIMIT, LIMIT, LIMIT))
