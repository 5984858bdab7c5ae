"""A panda and a ur5, against pinocchio and coal."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.suites.arm_peers import Meshes, coal_solids, our_solids
from cspace import BLOCKED, FREE, Arm, build_arm_space, build_joint_map
from tests.arms.test_joint_map import draw_border_points
from tests.arms.test_lines import check_motion, sample_deviation
from tests.helpers.urdfs import pose_at, poses_apart

pin = pytest.importorskip("pinocchio")

pytestmark = pytest.mark.filterwarnings(
    "ignore::cspace.MeshWarning", "ignore:.*without collision geometry"
)

TIPS = {"panda": "panda_hand", "ur5": "tool0"}


class RealArm(NamedTuple):
    """An arm, its frame at the tip, and poses of its frames by pinocchio, shape (..., 4, 4)."""

    name: str
    folder: Path
    arm: Arm
    model: Any
    tip: str
    pose: Callable[..., np.ndarray]


@pytest.fixture(scope="module", params=["panda", "ur5"])
def real(request: pytest.FixtureRequest, data: Path) -> RealArm:
    name = request.param
    folder = data / "arms" / name
    arm = Arm.from_urdf(folder / f"{name}.urdf", folder / f"{name}.srdf")
    model = pin.buildModelFromUrdf(str(folder / f"{name}.urdf"), mimic=True)
    state = model.createData()
    indices = [model.joints[model.getJointId(joint)].idx_q for joint in arm.joints]

    def pose(q: np.ndarray, frame: str = TIPS[name]) -> np.ndarray:
        poses = []
        for row in q.reshape(-1, arm.dof):
            theirs = pin.neutral(model)
            theirs[indices] = row
            pin.framesForwardKinematics(model, state, theirs)
            poses.append(state.oMf[model.getFrameId(frame)].homogeneous.copy())
        return np.array(poses).reshape(*q.shape[:-1], 4, 4)

    return RealArm(name, folder, arm, model, TIPS[name], pose)


def test_poses_joint_order_and_states_agree_with_pinocchio(real: RealArm) -> None:
    arm = real.arm
    model = pin.buildModelFromUrdf(str(real.folder / f"{real.name}.urdf"))
    pin.loadReferenceConfigurations(model, str(real.folder / f"{real.name}.srdf"), False)
    assert arm.joints == tuple(name for name in real.model.names if name in arm.joints)
    q = np.random.default_rng(0).uniform(*arm.ranges(), (2, 3, arm.dof))
    for frame in arm.frames:
        np.testing.assert_allclose(arm.pose(q, frame), real.pose(q, frame), atol=1e-9)
    states = model.referenceConfigurations
    named = {key.partition("/")[2] for key in arm.named_configurations}
    assert named == {each.key() for each in states}
    for key, values in arm.named_configurations.items():
        group, _, state = key.partition("/")
        for joint in arm.groups[group]:
            index = model.joints[model.getJointId(joint)].idx_q
            assert values[arm.joints.index(joint)] == states[state][index]


def test_poses_are_reached_by_pinocchio(real: RealArm) -> None:
    arm = real.arm
    for q in np.random.default_rng(1).uniform(*arm.ranges(), (30, arm.dof)):
        pose = real.pose(q)
        solutions = arm.inverse(real.tip, pose, max_solutions=4)
        assert ((solutions >= arm.lower) & (solutions <= arm.upper)).all()
        for reached in real.pose(solutions):
            assert (np.array(poses_apart(reached, pose)) <= (1e-4, 1e-3)).all()


@pytest.mark.parametrize("real", ["panda"], indirect=True)
def test_lines_are_followed_by_pinocchio(real: RealArm) -> None:
    """Go up, then to the side while the frame turns, then 0.3 m at a constant rotation."""
    solids = [("ball", "sphere", pose_at(0.3, -0.6, 0.2), (0.1,))]
    space = build_arm_space(our_solids(solids), real.arm)
    ratios = []
    stops = set()
    for start in space.sample_free(8, np.random.default_rng(3)):
        corners = np.array([real.pose(start)] * 3)
        corners[:, :3, 3] += [(0, 0, 0.1), (0.1, 0.05, 0.1), (0.1, 0.35, 0.1)]
        corners[1:, :3, :3] = Rotation.from_euler("z", 0.3).as_matrix() @ corners[0, :3, :3]
        motion = space.follow_line(start, real.tip, corners)
        check_motion(motion, real.arm, real.pose)
        assert np.asarray(space.certify_path(motion.waypoints)).all()
        stops.add(motion.stopped_by)
        if motion.certified:
            ratios.append(motion.deviation / sample_deviation(motion, real.pose)[0])
    assert len(stops) > 1 and ratios
    # The bound is not far above the truth.
    assert max(ratios) < 2.0


@pytest.mark.parametrize("real", ["panda"], indirect=True)
def test_joint_maps_agree_with_coal(real: RealArm) -> None:
    """Place a box beside the arm; include the pairs of links that few joints move."""
    arm = real.arm
    solids = [("box", "box", pose_at(0.5, 0.3, 0.5), (0.2, 0.2, 0.4))]
    srdf = real.folder / f"{real.name}.srdf"
    meshes = Meshes(real.folder / f"{real.name}.urdf", arm.joints, coal_solids(solids), srdf)
    held = np.array([0.0, 0.3, 0.0, -1.8, 0.0, 1.9, 0.6])
    space = build_arm_space(our_solids(solids), arm)
    joint_map = build_joint_map(space, 0.08, arm.joints[:2], held_joints=held)
    free, mixed, _ = np.array(joint_map.count()) / joint_map.grid.size
    assert free > 0.7 and mixed < 0.3
    for state in (FREE, BLOCKED):
        for point in draw_border_points(joint_map, state, np.random.default_rng(2), 40):
            q = held.copy()
            q[:2] = point
            if state == FREE:
                assert not meshes.is_wrong(q)
            else:
                assert meshes.collides(q)
