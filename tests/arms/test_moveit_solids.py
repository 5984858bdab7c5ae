"""Random planning scenes of MoveIt against solids that are sampled by other code."""

import json
import math
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, event, given, settings
from hypothesis import strategies as st

from cspace import Arm, Workspace, build_arm_space
from cspace.arms import read_moveit_scene
from cspace.errors import FileError, InputError
from tests.helpers.urdfs import joint, link, pose_of, write_urdf

SIDE = 1e-3
"""Side of the probe, a cube at the origin of the link ``tip``, metres."""

LIMIT = 15.0
"""Limit of the joints x, y and z, metres."""

NAMES = ("a", "b", "c", "d", "e", "a/0", "a/1", "b/0", "object 1", 7, "7", "tip", "flange", "hall")
"""Ids of objects; some clash with others, with parts of others, or with frames."""

FRAMES = ("base", "stand", "tip", "flange")
TETRAHEDRON = np.array([(0.0, 0.0, 0.0), (0.5, 0.1, 0.0), (0.0, 0.6, 0.2), (0.1, 0.0, 0.7)])


@pytest.fixture(scope="module")
def probe(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Arm]:
    """Write a tiny cube that three joints slide, with a flange beside it and a stand beside the
    base."""
    path = write_urdf(
        tmp_path_factory.mktemp("probe"),
        *(link(name) for name in ("base", "stand", "beam", "cart", "flange")),
        link("tip", ((SIDE,) * 3, (0, 0, 0))),
        joint("mount", "base", "stand", at=(0.3, -1.2, 0.4), rpy=(0.5, -0.8, 1.9), kind="fixed"),
        *(
            joint(name, parent, child, at, axis, "prismatic", (-LIMIT, LIMIT))
            for name, parent, child, at, axis in (
                ("x", "base", "beam", (0.1, 0, 0), (1, 0, 0)),
                ("y", "beam", "cart", (0, -0.2, 0), (0, 1, 0)),
                ("z", "cart", "tip", (0, 0, 0.3), (0, 0, 1)),
            )
        ),
        joint("wrist", "tip", "flange", at=(0.2, 0.1, -0.3), rpy=(-1.1, 0.4, 0.7), kind="fixed"),
    )
    return path, Arm.from_urdf(path)


# ---- an independent reading ----------------------------------------------------------------------


def motion(position: Any, quaternion: Any) -> np.ndarray:
    """Return the rigid motion of a position and a quaternion x, y, z, w, which need not have length
    1."""
    x, y, z, w = np.array(quaternion) / math.sqrt(sum(number**2 for number in quaternion))
    matrix = np.eye(4)
    matrix[:3, :3] = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    matrix[:3, 3] = position
    return matrix


def sample(kind: str, sizes: Any, rng: np.random.Generator) -> np.ndarray:
    """Draw points of a solid, shape (8, 3); half of them lie on its surface."""
    at = rng.uniform(-1, 1, (8, 3))
    at[:4] /= np.abs(at[:4]).max(axis=1, keepdims=True)
    if kind == "box":
        return 0.5 * at * sizes
    if kind == "sphere":
        at *= np.abs(at).max(axis=1, keepdims=True) / np.linalg.norm(at, axis=1, keepdims=True)
        return at * sizes[0]
    if kind == "mesh":
        shares = rng.dirichlet((1, 1, 1, 1), 8)
        return shares @ TETRAHEDRON
    height, radius = sizes
    at[:, :2] *= np.abs(at[:, :2]).max(axis=1, keepdims=True) / np.linalg.norm(
        at[:, :2], axis=1, keepdims=True
    )
    narrow = (1 - at[:, 2:]) / 2 if kind == "cone" else 1.0
    return np.hstack([at[:, :2] * radius * narrow, at[:, 2:] * height / 2])


class Part(NamedTuple):
    """A shape of an object, and the poses that lead from it to the frame of its header."""

    kind: str
    sizes: tuple[float, ...]
    pose: np.ndarray

    def points(self, to_scene: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw points in the frame of the scene."""
        placed = to_scene @ self.pose
        return sample(self.kind, self.sizes, rng) @ placed[:3, :3].T + placed[:3, 3]


class Case(NamedTuple):
    """A message, and what it means."""

    message: dict[str, Any]
    root: str
    base_pose: np.ndarray
    world: dict[Any, tuple[str, list[Part]]]
    attached: list[tuple[Any, str, str, list[Part]]]
    state: dict[str, float]
    is_repeated: bool

    def may_touch(self, one: str, other: str) -> bool:
        """Return True if the matrix allows a pair by its entry and the defaults of both."""
        matrix = self.message["allowed_collision_matrix"]
        names, found = matrix["entry_names"], []
        if one in names and other in names:
            found.append(matrix["entry_values"][names.index(one)][names.index(other)])
        for name, value in zip(
            matrix["default_entry_names"], matrix["default_entry_values"], strict=True
        ):
            found += [value] * (name in (one, other))
        return bool(found) and all(found)

    def clashes(self) -> bool:
        """Return True if two objects or two shapes have one name, or an object has that of a frame."""
        objects = [*((name, parts) for name, (_, parts) in self.world.items())]
        objects += [(name, parts) for name, _, _, parts in self.attached]
        names = [str(name) for name, _ in objects]
        shapes = [
            name if len(parts) == 1 else f"{name}/{number}"
            for name, (_, parts) in zip(names, objects, strict=True)
            for number in range(len(parts))
        ]
        repeated = (
            len(set(shapes)) < len(shapes) or len(set(names)) < len(names) or self.is_repeated
        )
        taken = {"base", "stand", "beam", "cart", "tip", "flange"}
        return repeated or not taken.isdisjoint([*names, *shapes])


COORDINATES = st.floats(-2.0, 2.0)
LENGTHS = st.floats(0.05, 1.0)


@st.composite
def poses(draw: st.DrawFn, scale: bool = True) -> tuple[dict[str, Any], np.ndarray]:
    """Draw a pose as a message, and as a motion."""
    position = draw(st.tuples(COORDINATES, COORDINATES, COORDINATES))
    quaternion = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 4)))
    quaternion = (
        quaternion if np.linalg.norm(quaternion) > 1e-3 else np.array((0.5, -0.5, 0.5, 0.5))
    )
    quaternion /= np.linalg.norm(quaternion)
    matrix = motion(position, quaternion)
    if scale:
        quaternion *= draw(st.sampled_from([1.0, 1e-9, 3.0, 1e-160]))
    message: dict[str, Any] = {"position": list(position), "orientation": quaternion.tolist()}
    if draw(st.booleans()):
        message = {
            name: dict(zip("xyzw", numbers, strict=False)) for name, numbers in message.items()
        }
    return message, matrix


@st.composite
def objects(draw: st.DrawFn, frame: str) -> tuple[dict[str, Any], list[Part]]:
    """Draw a collision object without its id, and its shapes."""
    message: dict[str, Any] = (
        {"header": {"frame_id": frame}} if frame != "world" or draw(st.booleans()) else {}
    )
    whole = np.eye(4)
    if draw(st.booleans()):
        message["pose"], whole = draw(poses())
    kinds = ["box", "sphere", "cylinder", "cone", "mesh"]
    parts: dict[str, list[Part]] = {"primitives": [], "meshes": []}
    for kind in draw(st.lists(st.sampled_from(kinds), min_size=1, max_size=3)):
        pose_message, pose = draw(poses())
        sizes: tuple[float, ...] = draw(st.tuples(LENGTHS, LENGTHS, LENGTHS))
        if kind == "mesh":
            field, shape = "meshes", {"vertices": TETRAHEDRON.tolist(), "triangles": FACES}
        else:
            number = 1 + ("box", "sphere", "cylinder", "cone").index(kind)
            sizes = sizes[: {"box": 3, "sphere": 1}.get(kind, 2)]
            padded = [*sizes, *[0.0] * draw(st.sampled_from([0, 3 - len(sizes)]))]
            written = draw(st.sampled_from([kind, kind.upper(), number]))
            field, shape = "primitives", {"type": written, "dimensions": padded}
        message.setdefault(field, []).append(shape)
        message.setdefault(POSES[field], []).append(pose_message)
        parts[field].append(Part(kind, sizes, whole @ pose))
    for field, poses_field in POSES.items():
        if (
            len(message.get(field, ())) == 1 and draw(st.integers(0, 3)) == 0
        ):  # a single shape needs no pose
            del message[poses_field]
            parts[field] = [parts[field][0]._replace(pose=whole)]
    return message, [part for field in POSES for part in parts[field]]


POSES = {"primitives": "primitive_poses", "meshes": "mesh_poses"}
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Draw a scene."""
    root = draw(st.sampled_from(["world", "base", "stand", "hall"]))
    base_pose = draw(poses())[1] if root == "hall" else np.eye(4)
    world: dict[Any, tuple[str, list[Part]]] = {}
    written, is_repeated = [], False
    pool = st.sampled_from(NAMES[:3] if draw(st.booleans()) else NAMES)
    for name in draw(st.lists(pool, max_size=5)):
        message, parts = draw(objects(root))
        if draw(st.booleans()):
            message["operation"] = draw(st.sampled_from([0, "add", "\0"]))
        written.append({"id": name} | message)
        is_repeated |= str(name) in world
        world[str(name)] = root, parts
    attached, carried = [], []
    held = st.lists(st.sampled_from(["mug", "mug/0", *NAMES]), max_size=2) | st.sampled_from(
        [["mug"], ["mug", "cup"]]
    )
    for name in draw(held):
        carrier = draw(st.sampled_from(["tip", "flange"]))
        frame = draw(st.sampled_from([carrier, root]))
        message, parts = draw(objects(frame))
        message["header"] = {"frame_id": frame}
        carried.append({"link_name": carrier, "object": {"id": name} | message})
        attached.append((name, carrier, frame, parts))
    state = dict(zip("xyz", draw(st.tuples(COORDINATES, COORDINATES, COORDINATES)), strict=True))
    known = ["tip", *draw(st.lists(st.sampled_from(["mug", "flange", *world]), unique=True))]
    shares = draw(st.lists(st.booleans(), min_size=len(known) ** 2, max_size=len(known) ** 2))
    values = [
        [shares[min(i, j) * len(known) + max(i, j)] for j in range(len(known))]
        for i in range(len(known))
    ]
    defaults = draw(st.dictionaries(st.sampled_from(["mug", *known]), st.booleans(), max_size=3))
    scene = {
        "world": {"collision_objects": written},
        "allowed_collision_matrix": {
            "entry_names": known,
            "entry_values": values,
            "default_entry_names": list(defaults),
            "default_entry_values": list(defaults.values()),
        },
        "robot_state": {
            "joint_state": {"name": list(state), "position": list(state.values())},
            "attached_collision_objects": carried,
        },
    }
    return Case(scene, root, base_pose, world, attached, state, is_repeated)


@pytest.mark.filterwarnings("ignore:.*enlarge the robot", "ignore:.*units")
@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    max_examples=100,
    phases=set(Phase) - {Phase.explain},
)
@given(case=cases(), seed=st.integers(0, 2**20))
def test_points_in_solids_of_a_scene_are_never_free(
    tmp_path: Path, probe: tuple[Path, Arm], case: Case, seed: int
) -> None:
    path, arm = probe
    file = tmp_path / "scene.yaml"
    file.write_text(json.dumps(case.message))
    base_pose = case.base_pose if case.root == "hall" else None
    if case.clashes():
        event("names clash")
        with pytest.raises((FileError, InputError), match=r"has the object|twice"):
            build_arm_space(read_moveit_scene(file), arm, base_pose=base_pose)
        return
    if not case.world and not case.attached:
        with pytest.raises(InputError, match="holds no shape"):
            read_moveit_scene(file)
        return
    space = build_arm_space(read_moveit_scene(file), arm, base_pose=base_pose)
    assert len(space.obstacles) == sum(len(parts) for _, parts in case.world.values())
    assert len(space.arm.links) == 1 + sum(len(parts) for _, _, _, parts in case.attached)
    # Frames in the frame of the base; those of links where the state has them.
    of = {name: pose_of(path, name, case.state) for name in FRAMES}
    of |= {"world": np.eye(4), "hall": np.linalg.inv(case.base_pose)}
    rng = np.random.default_rng(seed)
    root_to_base, base_to_root = of[case.root], np.linalg.inv(of[case.root])
    solids = []
    for name, (frame, parts) in case.world.items():
        for part in parts:
            points = part.points(base_to_root @ of[frame], rng)
            solids.append((name, points @ root_to_base[:3, :3].T + root_to_base[:3, 3]))
    tip, home = of["tip"], pose_of(path, "tip", {})[:3, 3]
    grips = [("tip", np.zeros((1, 3)), 0.5 * SIDE)]
    for name, _, frame, parts in case.attached:
        # The joints only slide, so that the tip keeps its rotation.
        grips += [(str(name), each.points(of[frame], rng) - tip[:3, 3], 0.0) for each in parts]
    tested = 0
    for (grip, points, reach), (name, obstacles) in product(grips, solids):
        if case.may_touch(grip, name):
            event("may touch")
            continue
        away = rng.normal(size=(len(obstacles), 3))
        away *= (
            (1 - 1e-9)
            * reach
            * rng.choice([0.0, 1.0], (len(away), 1))
            / np.linalg.norm(away, axis=1)[:, None]
        )
        q = obstacles - home - points[rng.integers(len(points), size=len(obstacles))] + away
        q = q[(np.abs(q) <= LIMIT).all(axis=1)]
        assert not len(q) or not space.is_free(q).any()
        tested += len(q)
    event(f"{'some' if tested else 'no'} points")
    assert space.is_free((LIMIT, LIMIT, LIMIT)) or any(
        frame != "tip" for _, _, frame, _ in case.attached
    )
    for _, obstacles in solids:
        check_cells(file, obstacles @ base_to_root[:3, :3].T + base_to_root[:3, 3])


def check_cells(file: Path, points: np.ndarray) -> None:
    """Check that a map's workspace has the points, in the frame of the scene, in its occupied
    cells."""
    lower, spacing = np.array((-1.5, -1.0, -2.0)), 0.4
    workspace = Workspace.from_moveit_scene(file, spacing, (*lower, 2.0, 1.5, 1.0))
    cells = np.floor((points - lower) / spacing).astype(int)
    inside = ((cells >= 0) & (cells < workspace.outer.shape)).all(axis=1)
    assert workspace.outer[tuple(cells[inside].T)].all()
