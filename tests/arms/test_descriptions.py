"""What URDF and SRDF say of their numbers and names is heard."""

import warnings

import pytest

from cspace import AngleWarning, Arm, FileError, Robot
from tests.helpers.urdfs import planar


def write_arm(folder, velocity, kind="revolute"):
    """Write a robot of one joint."""
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    path = folder / "r.urdf"
    path.write_text(
        f'<robot name="r"><link name="base">{box}</link><link name="arm"><collision>'
        '<origin xyz="0.3 0 0"/><geometry><box size="0.5 0.05 0.05"/></geometry></collision></link>'
        f'<joint name="j" type="{kind}"><parent link="base"/><child link="arm"/>'
        '<origin xyz="0 0 0.2"/><axis xyz="0 0 1"/>'
        f'<limit lower="-3.1" upper="3.1" effort="1" velocity="{velocity}"/></joint>'
        '<ros2_control name="x" type="system"><joint name="j"/></ros2_control></robot>'
    )
    return path


def test_speeds_in_degrees_are_warned_of(tmp_path):
    with pytest.warns(AngleWarning) as caught:
        Arm.from_urdf(write_arm(tmp_path, 180))
    text = str(caught[0].message)
    assert "velocity at the limit of joint 'j', the first of 1, is beyond 8 turns a second" in text
    assert text.endswith("; it is in rad/s, and 180 degrees are 3.14159 rad")
    with warnings.catch_warnings(action="error"):
        Arm.from_urdf(write_arm(tmp_path, 3.14))
        Arm.from_urdf(write_arm(tmp_path, 180, "prismatic"))


def test_groups_of_groups_are_read_once_each(tmp_path):
    def count(levels):
        groups = "".join(
            f'<group name="g{k}"><group name="g{k - 1}"/><group name="g{k - 1}"/></group>'
            for k in range(1, levels)
        )
        srdf = f'<robot name="r">{groups}<group name="g0"><joint name="j"/></group></robot>'
        (tmp_path / "r.srdf").write_text(srdf)
        return Arm.from_urdf(write_arm(tmp_path, 1), tmp_path / "r.srdf").groups

    assert count(60)["g59"] == ("j",)


def test_another_robots_srdf_is_warned_of(tmp_path):
    group = '<group name="arm"><joint name="shoulder"/></group>'
    (tmp_path / "a.srdf").write_text(f'<robot name="other">{group}</robot>')
    with pytest.warns(UserWarning, match="describes the robot 'other', and the URDF 'small'"):
        Arm.from_urdf(planar(tmp_path), tmp_path / "a.srdf")


@pytest.mark.parametrize(("tag", "page"), [("sdf", "Bring"), ("mujoco", "Bring"), ("x", "")])
def test_robots_of_other_formats_are_named(tmp_path, tag, page):
    (tmp_path / "robot.urdf").write_text(f"<{tag}><model/></{tag}>")
    with pytest.raises(FileError, match=f"holds <{tag}>, not <robot>.*{page}"):
        Robot.from_urdf(tmp_path / "robot.urdf")
