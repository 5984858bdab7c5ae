"""Arms from URDF files: joints, limits, bodies and pairs, against yourdfpy's own kinematics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy

from cspace.arms import Arm
from cspace.errors import FileError, InputError
from urdfs import joint, link, planar, random_arm, written

BAR = ((1.0, 0.1, 0.1), (0.5, 0, 0))


@pytest.mark.parametrize("seed", range(4))
def test_places_of_links(tmp_path: Path, seed: int) -> None:
    """All kinds of joints, and one that mimics: as yourdfpy places them."""
    path = random_arm(tmp_path, seed)
    arm = Arm.from_urdf(path)
    urdf = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert list(arm.joints) == urdf.actuated_joint_names
    for q in np.random.default_rng(seed).uniform(-0.4, 0.7, (5, arm.dof)):
        urdf.update_cfg(q)
        for name, pose in arm.poses(q).items():
            np.testing.assert_allclose(pose, urdf.get_transform(name), atol=1e-9)


def test_base_and_tip(tmp_path: Path) -> None:
    """Joints between them move; the others stand at zero, or at the limit next to it."""
    path = written(
        tmp_path,
        *(link(name, BAR) for name in "abcd"),
        joint("one", "a", "b", at=(1, 0, 0)),
        joint("two", "b", "c", at=(1, 0, 0), limits=(0.5, 1.0)),
        joint("three", "b", "d", at=(1, 0, 0), kind="prismatic", axis=(0, 0, 2)),
    )
    assert Arm.from_urdf(path).joints == ("one", "two", "three")
    arm = Arm.from_urdf(path, tip="d")
    assert arm.joints == ("one", "three")
    np.testing.assert_allclose(arm.poses((0.0, 0.2))["d"][:3, 3], (2, 0, 0.2))
    # What hangs on b by a joint that does not move is of its body.
    assert {each.name: each.body for each in arm.links} == {"a": 0, "b": 1, "c": 1, "d": 2}
    only = Arm.from_urdf(path, base="b", tip="c")
    assert [each.name for each in only.links] == ["b", "c", "d"]
    assert only.lower.tolist() == [0.5]


def test_which_links_may_touch(tmp_path: Path) -> None:
    """Neighbours, also over a link without geometry; or what an SRDF says, and nothing else."""
    path = written(
        tmp_path,
        link("a", BAR),
        link("bare"),
        link("b", BAR),
        link("c", BAR),
        joint("one", "a", "bare"),
        joint("two", "bare", "b", axis=(1, 0, 0)),
        joint("three", "b", "c", at=(1, 0, 0)),
    )
    assert Arm.from_urdf(path).allowed == {("a", "b"), ("b", "c")}
    srdf = tmp_path / "arm.srdf"
    srdf.write_text('<robot name="small"><disable_collisions link1="c" link2="a" reason="Never"/></robot>')
    assert Arm.from_urdf(path, srdf).allowed == {("a", "c")}
    srdf.write_text('<robot name="small"><disable_collisions link1="c" link2="z"/></robot>')
    with pytest.raises(FileError, match="names link 'z'"):
        Arm.from_urdf(path, srdf)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"limits": (1.0, -1.0)}, "limits are 1 and -1"),
        ({"limits": None}, "has no limits"),
        ({"kind": "floating"}, "is floating; it must be one of fixed"),
        ({"extra": '<mimic joint="elbow"/>', "kind": "revolute"}, None),
    ],
)
def test_bad_joints(tmp_path: Path, changes: dict[str, Any], words: str | None) -> None:
    path = planar(tmp_path, **changes)
    if words is None:
        assert Arm.from_urdf(path).joints == ("elbow",)
        return
    with pytest.raises(InputError, match=words):
        Arm.from_urdf(path)


def test_bad_input(tmp_path: Path) -> None:
    path = planar(tmp_path)
    for options in ({"tip": "hand"}, {"base": "hand"}):
        with pytest.raises(InputError, match=r"is 'hand'.*has foot, upper, fore"):
            Arm.from_urdf(path, **options)
    with pytest.raises(InputError, match="is not below"):
        Arm.from_urdf(path, base="fore", tip="foot")
    with pytest.raises(InputError, match="no joint that moves"):
        Arm.from_urdf(path, base="fore")
    arm = Arm.from_urdf(path)
    from cspace import Robot

    ball = Robot.ball(0.1).shape
    with pytest.raises(InputError, match="a link has it"):
        arm.attach("fore", ball, "upper")
    with pytest.raises(InputError, match="is 'wing'"):
        arm.attach("tool", ball, "wing")
    with pytest.raises(InputError, match="rigid motion"):
        arm.attach("tool", ball, "fore", 2.0 * np.eye(4))
    with pytest.raises(FileError, match=r"axis '0.0 0.0 0.0' at the joint 'shoulder'"):
        Arm.from_urdf(planar(tmp_path, axis=(0, 0, 0)))
    bare = written(tmp_path, link("a"), link("b"), joint("one", "a", "b"))
    with pytest.raises(InputError, match="no collision geometry"):
        Arm.from_urdf(bare)
