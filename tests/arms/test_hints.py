"""Hints of arms, their maps and lines: each is followed by code."""

import math

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import planners
from cspace import Robot, Workspace
from cspace.arms import (
    Arm,
    JointValues,
    PosedShape,
    PoseGoal,
    build_arm_space,
    build_joint_map,
)
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.urdfs import joint, link, planar, pose_at, posed_box, write_urdf

ZERO = (0.0, 0.0)
CONTINUOUS = {"kind": "continuous", "limits": None}
NEAR = posed_box((0.2, 0.2, 0.2), 1.5, 0.0)
"""A box that the outstretched arm touches."""

FOOT_BOX = posed_box((0.1, 0.1, 0.1), 0.0, 0.0, -0.2)
"""A box that the foot touches."""

FAR = posed_box((0.2, 0.2, 0.2), 0.0, 1.5)


def arm(folder, **options):
    """Read an arm of two joints."""
    return Arm.from_urdf(planar(folder), **options)


def held_ball(folder):
    """Read an arm that holds a ball."""
    return arm(folder).attach("ball", Robot.ball(0.1).shape, "fore")


def space(folder, *, near=FAR, **options):
    """Build the space of an arm beside a box."""
    return build_arm_space({"box": near}, arm(folder), **options)


def chain(folder, *joints):
    """Read an arm of one more link for each joint, given by their options."""
    bar = ((0.3, 0.1, 0.1), (0.2, 0, 0))
    links = [link(f"l{number}", bar) for number in range(len(joints) + 1)]
    between = [
        joint(
            **{"name": f"j{n}", "parent": f"l{n}", "child": f"l{n + 1}", "at": (0.5, 0, 0)} | more
        )
        for n, more in enumerate(joints)
    ]
    return write_urdf(folder, *links, *between)


def read_chain(folder, *joints, **options):
    """Read the arm of a chain."""
    return Arm.from_urdf(chain(folder, *joints), **options)


def goal_at(x, y, tolerance=(1e-3, math.inf)):
    """Return the goal of a place of the forearm."""
    return PoseGoal("fore", pose_at(x, y), tolerance)


def mapped(folder, **options):
    """Build the map of both joints."""
    return build_joint_map(space(folder), 0.5, **options)


def follow(folder, *poses, **options):
    """Move the forearm along a line from a bent configuration."""
    moved = space(folder)
    start = (0.3, 0.5)
    poses = [moved.arm.pose(start, "fore"), *poses] if poses else np.zeros((2, 2))
    return moved.follow_line(start, "fore", poses, **options)


def turned(folder, angle):
    """Return the pose of the forearm at the start of a line, turned."""
    pose = arm(folder).pose((0.3, 0.5), "fore").copy()
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_euler("z", angle).as_matrix()
    return pose


def carrying(folder):
    """Build the space of an arm that carries a ball, which carries another one."""
    carried = space(folder)
    carried.attach("ball", Robot.ball(0.05).shape, "fore", pose=pose_at(1.2, 0))
    carried.attach("tip", Robot.ball(0.01).shape, "ball", pose=pose_at(0.2, 0))
    return carried


TENTH = {"limits": (0.1, 0.1)}


@pytest.mark.filterwarnings("ignore:.*only drawn:UserWarning")
@refusals(
    "call, hint",
    # Sphere models.
    (
        lambda f: arm(f).spheres(number={"foot": 1, "upper": 1}),
        "number lacks 'fore' ... link",
    ),
    (
        lambda f: arm(f).spheres(number=1).save(f / "spheres.urdf"),
        "template is missing ... source",
    ),
    (
        lambda f: held_ball(f).spheres(number=1),
        "link 'ball' consists of balls already ... spheres",
    ),
    (lambda f: arm(f).spheres(), "number is None and tolerance is None ... exactly"),
    (lambda f: arm(f).spheres(number=2, kind="both"), "kind is 'both'"),
    (lambda f: arm(f).spheres(tolerance=1e-9), "its proof needs too many cells below 0.00051 m"),
    # Arms.
    (lambda f: arm(f).inverse("tool9", np.eye(4)), "frame is 'tool9' ... foot, upper, fore"),
    (
        lambda f: arm(f).inverse("fore", pose_at(1, 0), tolerance=(0.01, math.nan)),
        "tolerance is (0.01, nan) ... two numbers",
    ),
    (
        lambda f: arm(f).inverse("fore", pose_at(1, 0), near=np.zeros((2, 2))),
        "near has shape (2, 2) ... one configuration",
    ),
    (
        lambda f: arm(f, joints=["elbow"], tip="fore"),
        "joints is given with tip ... move",
    ),
    (
        lambda f: planners.plan(space(f), ZERO, goal_at(9, 0)),
        "goal is out of reach of fore: the nearest pose that it ... within 0.001 m",
    ),
    (
        lambda f: arm(f).inverse("foot", pose_at(0, 0)),
        "frame is 'foot' ... moves",
    ),
    (
        lambda f: arm(f, joints=["shoulder"]).configuration(JointValues(elbow=1.0, shoulder=0.0)),
        "values has elbow at 1 ... holds",
    ),
    (
        lambda f: arm(f).configuration("home"),
        "values is 'home' ... none",
    ),
    (
        lambda f: arm(f, joints="arm"),
        "joints is 'arm' ... groups",
    ),
    (
        lambda f: arm(f).configuration([0.0]),
        "values is [0.0] ... map names to numbers",
    ),
    (
        lambda f: arm(f).attach("tool", shapely.box(0, 0, 1, 1), "fore"),
        "shape is in the plane ... arms",
    ),
    (
        lambda f: arm(f).attach("fore", Robot.ball(0.1).shape, "fore"),
        "name is 'fore' ... link",
    ),
    (
        lambda f: carrying(f).detach("ball"),
        "name is 'ball' ... 'tip'",
    ),
    (
        lambda f: arm(f).pose((0, 0, 0), "fore"),
        "q has shape (3,) ... shoulder",
    ),
    (
        lambda f: read_chain(f, {"limits": None}),
        "arm.urdf: joint 'j0' has no limits ... prismatic",
    ),
    (
        lambda f: read_chain(f, {"limits": (1, -1)}),
        "arm.urdf: joint 'j0': limits are 1 and -1 ... lower",
    ),
    (
        lambda f: read_chain(f, {"kind": "fixed", "limits": None}),
        "arm.urdf has no joint that moves there ... least",
    ),
    (
        lambda f: arm(f, held_joints={"elbow": 9.0}, joints=["shoulder"]),
        "held_joints has elbow at 9 ... -3 and 3",
    ),
    (
        lambda f: read_chain(f, *[{}] * 70),
        "arm.urdf has 71 bodies that move against each other ... 64",
    ),
    (
        lambda f: Arm.from_urdf(bare(f)),
        "arm.urdf has no collision geometry ... arm's",
    ),
    (
        lambda f: arm(f, base="upper", tip="foot"),
        "tip is 'foot' ... not below 'upper'",
    ),
    # Obstacles.
    (
        lambda f: build_arm_space(
            {"box": Workspace.from_array(np.eye(3, dtype=bool), 0.1)}, arm(f)
        ),
        "obstacles hold 'box', a map of the plane ... arms",
    ),
    (
        lambda f: build_arm_space({"box": shapely.box(0, 0, 1, 1)}, arm(f)),
        "obstacles hold 'box', a shape of the plane ... arms",
    ),
    (
        lambda f: build_arm_space(Robot.ball(0.1).shape, arm(f)),
        "obstacles is a Balls ... workspace or a mapping",
    ),
    (
        lambda f: space(f).add_obstacle("post", FOOT_BOX),
        "foot touches obstacle 'post', or comes nearer than the ... moves",
    ),
    (
        lambda f: space(f).attach("box", link="fore", q=ZERO, pose=pose_at(1, 0)),
        "pose is given for an obstacle ... where",
    ),
    (
        lambda f: space(f).attach("ball", Robot.ball(0.01).shape, "fore", q=ZERO),
        "q is given for a new object ... picked",
    ),
    (
        lambda f: space(f).attach("box", Robot.ball(0.01).shape, "fore"),
        "name is 'box' ... obstacle",
    ),
    (
        lambda f: carrying(f).detach("tip", touch_links=["fore"]),
        "touch_links are given without q ... those of the obstacle",
    ),
    (
        lambda f: space(f).allow_collisions("fore"),
        "pairs is 'fore' ... pairs of names",
    ),
    (
        lambda f: build_arm_space({}, read_chain(f, {})).closest([0.0]),
        "obstacles are none ... nothing to touch",
    ),
    (
        lambda f: planners.plan(space(f, near=NEAR), ZERO, (1.0, 0.5)),
        "start (0, 0) is not proven free: fore is in collision with ... FREE",
    ),
    (lambda f: space(f, allowed_collisions=[("foot", "sky")]), "names 'sky'"),
    (lambda f: space(f, near=PosedShape(FAR.shape, 2.0 * np.eye(4))), "pose has the last row "),
    (lambda f: space(f).add_obstacle("fore", FAR), "name is 'fore' ... attached"),
    (
        lambda f: space(f).add_obstacle("post", FAR, touch_links=["fort"]),
        "touch_links names 'fort'",
    ),
    (
        lambda f: space(f).attach("box", link="fore"),
        "q is missing ... shoulder",
    ),
    (lambda f: space(f).set_padding("box", 9.0), "foot touches obstacle 'box', or comes nearer"),
    # Maps of joints.
    (
        lambda f: mapped(f, joints=("shoulder", "wrist")),
        "joints name 'wrist' ... shoulder, elbow",
    ),
    (lambda f: build_joint_map(space(f), 1e-5), "cells of 1e-05 rad and needs"),
    (
        lambda f: build_joint_map(build_arm_space({}, named_x(f, "yaw")), 0.5),
        "joints name 'yaw' ... blanks",
    ),
    (
        lambda f: build_joint_map(four(f), 0.5),
        "joints are j0, j1, j2, j3 ... different",
    ),
    (
        lambda f: build_joint_map(four(f), 0.5, joints=["j0", "j1"]),
        "held_joints is missing ... still",
    ),
    (
        lambda f: build_joint_map(build_arm_space({}, read_chain(f, {}, TENTH)), 0.5),
        "joints name 'j1', which stays at 0.1 ... moves",
    ),
    (
        lambda f: mapped(f, limits={"elbow": (1.0, -1.0)}),
        "limits['elbow'] are (1.0, -1.0) ... -3 and 3",
    ),
    (
        lambda f: build_joint_map(geared(f), 0.5),
        "limits are missing for 'j0', which is continuous",
    ),
    # Lines.
    (
        lambda f: follow(f),
        "poses has shape (2, 2) ... several",
    ),
    (
        lambda f: follow(f, turned(f, math.pi)),
        "poses[1] is half a turn from poses[0] ... round",
    ),
    (
        lambda f: follow(f, turned(f, 0.1), tolerance=(1e-20, 1e-20)),
        "tolerance is (1e-20, 1e-20) ... 7.8e-12",
    ),
    (lambda f: follow(f, pose_at(1e101, 0)), "poses has the coordinate 1e+101 m"),
    (lambda f: space(f).follow_line(ZERO, "fare", np.eye(4)), "did you mean 'fore'"),
)
def test_wrong_arguments_are_refused_in_one_line(call, hint, tmp_path):
    check_refused(lambda: call(tmp_path), hint)


def bare(folder):
    """Write a URDF without collision geometry."""
    path = planar(folder)
    path.write_text(path.read_text().replace("collision>", "visual>"))
    return path


def along(tolerance, frame="fore"):
    """Keep a bar along x."""
    return planners.Upright(frame, (1, 0, 0), (1, 0, 0), tolerance)


def named_x(folder, name):
    """Read an arm with a joint of a name."""
    return read_chain(folder, {"name": name}, {})


def four(folder):
    """Build the space of an arm of four joints."""
    return build_arm_space(
        {}, read_chain(folder, *[{"axis": axis} for axis in np.eye(3)[[2, 1, 2, 1]].tolist()])
    )


def geared(folder):
    """Build the space of an arm whose first joint turns another one by half its angle."""
    mimic = {"kind": "continuous", "limits": None, "extra": '<mimic joint="j0" multiplier="0.5"/>'}
    return build_arm_space({}, read_chain(folder, CONTINUOUS, mimic, {}))
