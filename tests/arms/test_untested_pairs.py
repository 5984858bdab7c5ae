"""Pairs of links that SRDF, matrix or URDF let touch: which are tested, and where others are named."""

import numpy as np
import pytest
from hypothesis import given

import planners
from cspace import Robot
from cspace.arms import Arm, build_arm_space, read_moveit_scene
from cspace.errors import ConfigurationError, InputError
from tests.arms.test_moveit import make_object
from tests.helpers.arm_oracle import ArmOracle, sample_configurations
from tests.helpers.strategies import examples, seeds
from tests.helpers.urdfs import joint, link, random_arm, write_urdf

BAR = ((1.0, 0.1, 0.1), (0.5, 0, 0))
FOLDED = (2.9, 2.9)


POST = ((0.1, 0.1, 3.0), (0.5, 0, 0))


def write_three(folder, *more):
    """Write three bars in a row; a post on the third one meets the first if the arm is folded."""
    return write_urdf(
        folder,
        *(link("a", BAR), link("b", BAR), link("c", BAR, POST, *more)),
        joint("one", "a", "b", at=(1, 0, 0.2)),
        joint("two", "b", "c", at=(1, 0, -0.2)),
    )


def write_srdf(reasons, *more):
    """Write an SRDF as a text."""
    rows = [
        f'<disable_collisions link1="{a}" link2="{b}" reason="{reason}"/>'
        for (a, b), reason in reasons.items()
    ]
    return f'<robot name="small">{"".join([*rows, *more])}</robot>'


ADJACENT = {("a", "b"): "Adjacent", ("b", "c"): "Adjacent"}


@pytest.mark.filterwarnings("ignore:.*gives the reason Never")
@given(seed=seeds)
@examples(12)
def test_pairs_called_never_and_those_forbidden_by_name_agree_with_fcl(tmp_path_factory, seed):
    path = random_arm(tmp_path_factory.mktemp("arm"), seed)
    plain = Arm.from_urdf(path)
    reasons = dict.fromkeys(plain.pairs, "Never") | dict.fromkeys(
        plain.allowed_collisions, "Adjacent"
    )
    arm = Arm.from_urdf(path, write_srdf(reasons))
    may_touch = sorted(arm.allowed_collisions)
    assert may_touch == sorted(plain.allowed_collisions)
    points = sample_configurations(arm, np.random.default_rng(seed), 60)
    space = build_arm_space({}, arm)
    for allowed in (may_touch, may_touch[1:]):
        oracle = ArmOracle(path, arm, {}, allowed)
        least = np.array([oracle.apart(q) for q in points])
        assert (least[space.is_free(points)] > 0.0).all()
        assert (least[~space.is_free(points)] < 1e-6).all()
        try:
            space.forbid_collisions(may_touch[:1])
        except (ConfigurationError, InputError):  # they always touch, or are on one body
            break


@pytest.mark.parametrize("reason", ["Never", "never"])
def test_a_pair_called_never_is_free_only_where_it_is_apart(tmp_path, reason):
    """Whatever the matrix of a scene says, which has no reasons."""
    path = write_three(tmp_path)
    text = write_srdf({**ADJACENT, ("c", "a"): reason})
    matrix = {"entry_names": list("abc"), "entry_values": [[True] * 3] * 3}
    world = {"collision_objects": [make_object("far", (9, 9, 9))]}
    scene = read_moveit_scene({"world": world, "allowed_collision_matrix": matrix})
    arm = Arm.from_urdf(path, text)
    for obstacles in ({}, scene):
        space = build_arm_space(obstacles, arm)
        assert space.arm.allowed_collisions.keys() == ADJACENT.keys()
        assert space.is_free([(0.0, 0.0), FOLDED]).tolist() == [True, False]
        assert not space.motion_is_free((0.0, 0.0), FOLDED)
    trusting = build_arm_space({}, arm, allowed_collisions=[("a", "c")])
    assert trusting.is_free(FOLDED)
    # Without an SRDF nobody has said never, and defaults and enabled pairs go before.
    assert build_arm_space(scene, Arm.from_urdf(path)).is_free(FOLDED)
    default = '<disable_default_collisions link="a"/>'
    assert ("a", "c") in Arm.from_urdf(
        path, text.replace("</r", f"{default}</r")
    ).allowed_collisions


def test_neighbours_are_tested_if_forbidden_by_name(tmp_path):
    space = build_arm_space({}, Arm.from_urdf(write_three(tmp_path)))
    q = (0.0, 3.0)
    assert space.is_free(q)
    space.forbid_collisions([("c", "b")])
    assert space.is_free([q, (0.0, 0.0)]).tolist() == [False, True]
    assert ("b", "c") not in space.arm.allowed_collisions
    with pytest.raises(InputError, match=r"pairs hold \('b', 'c'\); only pairs that may touch"):
        space.forbid_collisions([("b", "c")])
    space.allow_collisions([("b", "c")])
    assert space.is_free(q)
    space.attach("cup", Robot.ball(0.01), "c")
    with pytest.raises(InputError, match="only pairs that may touch, on two bodies"):
        space.forbid_collisions([("c", "cup")])


def test_pairs_that_no_proof_tests_are_named(tmp_path):
    path = write_three(tmp_path)
    arm = Arm.from_urdf(path, write_srdf(ADJACENT))
    named = "pairs not tested (2): a and b, b and c"
    assert repr(arm) == f"Arm(small: 2 joints, 3 links with geometry; {named})"
    space = build_arm_space({}, arm)
    assert named in repr(planners.plan(space, (0.0, 0.0), (0.2, 0.1), seed=1))
    space.allow_collisions([("a", "c"), ("a", "b")])
    space.attach("tip", Robot.ball(0.01), "c")
    assert space.unchecked == "pairs not tested (3): a and b, b and c, a and c"
    space.attach("top", Robot.ball(0.01), "c", touch_links=["a"])
    assert space.unchecked.endswith("(4): a and b, b and c, a and top, ...")
    bare = build_arm_space({}, Arm.from_urdf(path, write_srdf({})), allowed_collisions=ADJACENT)
    assert "not tested" not in repr(bare.arm)


def test_pairs_called_never_that_often_touch_are_warned_of(tmp_path):
    path = write_three(tmp_path, ((0.3, 0.3, 0.6), (0, 0, 0)))
    text = write_srdf({("a", "b"): "Adjacent", ("b", "c"): "Never"})
    message = (
        r"^robot_description: gives the reason Never to \[\('b', 'c'\)\], .* 100 of 100 random"
    )
    with pytest.warns(UserWarning, match=message):
        arm = Arm.from_urdf(path, text)
    hint = r"build_arm_space\(allowed_collisions=\[\('c', 'b'\)\]\) lets them touch"
    with pytest.raises(ConfigurationError, match=hint):
        build_arm_space({}, arm)
    assert build_arm_space({}, arm, allowed_collisions=[("c", "b")]).is_free((0.0, 0.0))
