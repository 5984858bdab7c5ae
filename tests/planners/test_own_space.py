"""A space of the user's own: plans, set-ups, results and refusals."""

import copy
import math

import numpy as np
import pytest
import shapely

import cspace
import planners
from cspace import InputError
from cspace.lanes import RouteGraph
from planners._catalogue import planner_names
from tests.helpers.handmade import build_empty
from tests.helpers.motions import sample_evenly
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.spaces import Disc, OpenSpace


class Searched(Disc):
    """A space with its own search, and with what else it may know."""

    searches = ("Around",)
    units = ("rad", "m")

    @property
    def max_velocity(self):
        return {"a": 1.0, "b": 0.5}

    def path_exists(self, q0, q1):
        return bool(np.asarray(q1)[1] < 1.9)

    def search(self, name, endpoints, options):
        assert name == "Around"
        return np.array([endpoints[0], (0.0, 1.8), endpoints[1]])


START, GOAL = (-1.5, 0.0), (1.5, 0.1)


@pytest.mark.parametrize(
    "axes, planner", [(("a", "b"), None), (("x", "y"), "BKPIECE1"), (("x", "y", "yaw"), "RRTstar")]
)
def test_a_plan_follows_motions_that_the_space_proves(axes, planner):
    space = Disc(*axes)
    turns = len(axes) == 3
    ends = [(*START, 0.5), (*GOAL, -1.0)] if turns else [START, GOAL]
    plan = planners.plan(space, *ends, planner=planners.Search(planner, 1000), seed=1)
    assert plan.certified and plan.planner == (planner or "RRTConnect")
    assert all(map(space.motion_is_free, plan.path[:-1], plan.path[1:])) and plan.recheck().all()
    # The shortest path consists of two tangents of the disc, and the arc between.
    radii = np.array([math.hypot(*START), math.hypot(*GOAL)])
    around = math.pi - math.atan2(GOAL[1], GOAL[0]) - np.arccos(1.0 / radii).sum()
    shortest = around + np.sqrt(radii**2 - 1.0).sum()
    assert plan.length > shortest and plan.gap >= 0.0
    assert math.isnan(plan.clearance) and math.isnan(plan.obstacle_distance)
    assert copy.deepcopy(plan).lower_bound == plan.lower_bound


def test_a_search_of_the_space_is_the_default_planner():
    space = Searched("a", "b")
    assert planners.choices(space).planners == (*planner_names(), "Around")
    for planner in (None, "around"):
        plan = planners.plan(space, START, GOAL, planner=planner)
        assert plan.certified and plan.planner == "Around" and len(plan.waypoints) == 3
    assert plan.is_connected and (plan.length_unit, plan.units) == ("rad or m", ("rad", "m"))
    assert plan.trajectory(max_acceleration=1.0).to_joint_trajectory().joint_names == ["a", "b"]
    apart = planners.plan(space, START, (0.0, 1.95))
    assert apart.is_disconnected and apart.status == "no path exists: proven"


def test_spaces_with_wrong_bounds_say_so():
    space = Disc("x", "y")
    for wrong in ((-2.0,) * 3, (2.0,) * 3), ((2.0, 2.0), (-2.0, -2.0)):
        space.bounds = wrong
        with pytest.raises(InputError, match=r"bounds are .*two rows of 2 numbers"):
            planners.plan(space, START, GOAL)


def make_own(**members):
    """Return a space in which all is free, with members of its own."""

    class Own(OpenSpace):
        axes = ("a", "b")

        @property
        def bounds(self):
            return (0.0,) * self.dim, (4.0,) * self.dim

    return type("Own", (Own,), members)()


def plan_own(**members):
    """Plan in a space with members of its own."""
    space = make_own(**members)
    size = len(FORKED) if space.axes == FORKED else 2
    return planners.plan(space, (1.0,) * size, (2.0,) * size)


FORKED = ("x", "y", "yaw", "fork")


@refusals(
    "call, message",
    (
        lambda: plan_own(axes=["a", "b"]),
        "axes are ... different names",
    ),
    (lambda: plan_own(axes=()), "axes are () ... different names"),
    (lambda: plan_own(axes=(1, 2)), "axes are (1, 2) ... different names"),
    (lambda: plan_own(axes="ab"), "axes are 'ab' ... tuple of different"),
    (lambda: plan_own(axes=("a", "a")), "axes are ('a', 'a') ... different names"),
    (lambda: plan_own(axes=lambda self: ("a", "b")), "axes are ... different names"),
    (
        lambda: plan_own(axes=FORKED),
        "axes are ('x', 'y', 'yaw', 'fork') ... rotation",
    ),
    (
        lambda: plan_own(axes=("q", "qx", "qy", "qz", "qw")),
        "axes are ('q', 'qx', 'qy', 'qz', 'qw') ... rotation",
    ),
    (
        lambda: plan_own(axes=("angle", "side"), periodic_axes=["angel"]),
        "periodic_axes has 'angel' ... angle, side ... did you mean 'angle'?",
    ),
    (lambda: plan_own(periodic_axes="b"), "periodic_axes is 'b' ... names, or one bool"),
    (
        lambda: plan_own(periodic_axes=("b", True)),
        "periodic_axes is ('b', True) ... names, or one bool",
    ),
    (lambda: plan_own(periodic_axes=()), "periodic_axes is () ... names, or one bool"),
    (
        lambda: plan_own(periodic_axes=(True,)),
        "periodic_axes is (True,) ... names, or one bool",
    ),
    (
        lambda: plan_own(periodic_axes=(1, 0)),
        "periodic_axes is (1, 0) ... bool",
    ),
    (lambda: plan_own(periodic_axes=None), "periodic_axes is None ... names"),
    (lambda: plan_own(bounds=None), "bounds is None ... numeric"),
    (lambda: plan_own(bounds=((0.0, 0.0),)), "bounds are ((0.0, 0.0),) ... rows"),
    (lambda: plan_own(bounds=((0.0, 0.0), (4.0, math.nan))), "bounds[1, 1] is nan"),
    (
        lambda: plan_own(searches="Around"),
        "searches are 'Around' ... tuple of names",
    ),
    (lambda: plan_own(searches=("Around", 2)), "searches are ('Around', 2) ... tuple of names"),
    (lambda: plan_own(units=("m",)), "units are ('m',) ... text"),
)
def test_what_a_space_says_wrongly_is_refused_before_a_search(call, message):
    check_refused(call, message)


@pytest.mark.parametrize(
    "rows, message",
    [
        ([START, (math.nan, math.nan), GOAL], r"search\[1, 0\] is nan"),
        ([START, (0.0, 9.0), GOAL], r"search returned the row \(0.0, 9.0\); a path stays within"),
        ([START, (0.0, -9.0), GOAL], r"search returned the row \(0.0, -9.0\); a path stays within"),
        ([(*START, 0.0), (*GOAL, 0.0)], r"search returned the shape \(2, 3\)"),
        (START, r"search returned the shape \(2,\)"),
        ([START], r"search returned a path from \(-1.5, 0.0\) to \(-1.5, 0.0\); a path leads from"),
        ([START, (0.0, 1.8)], r"search returned a path .* to \(0.0, 1.8\); a path leads from"),
        ([GOAL, START], "search returned a path .*, or has no row"),
        ([(-1.4, 0.0), GOAL], "search returned a path from"),
        ([], None),
        ([START, (0.0, 2.0 + 1e-10), GOAL], None),
    ],
)
def test_a_path_of_the_own_search_has_configurations_within_the_bounds(rows, message):
    class Found(Disc):
        searches = ("Own",)

        def motion_is_free(self, q0, q1):
            return not np.hypot(*np.asarray(q1)[:2]) < 1.0  # also of NaN

        def search(self, name, endpoints, options):
            return np.array(rows)

    space = Found("a", "b")
    if message is None:
        plan = planners.plan(space, START, GOAL)
        assert bool(plan) == plan.certified == (len(rows) > 0)
        return
    with pytest.raises(InputError, match=message):
        planners.plan(space, START, GOAL)


def test_every_door_checks_a_space_of_the_user():
    right = make_own()
    assert repr(right) == "Own(a, b)"
    plan = planners.plan(right, (1.0, 1.0), (2.0, 2.0))
    for call in (
        planners.simple_setup,
        planners.state_space,
        planners.choices,
        planners.warm_up,
        plan.recheck,
        plan.trajectory(max_velocity=1.0, max_acceleration=1.0).recheck,
    ):
        with pytest.raises(InputError, match=r"axes are \('x', 'y', 'yaw', 'fork'\).*rotation"):
            call(make_own(axes=FORKED))
        with pytest.raises(
            InputError, match=r"bounds are \(\(4\.0, 4\.0\), \(0\.0, 0\.0\)\).*rows"
        ):
            call(make_own(bounds=((4.0, 4.0), (0.0, 0.0))))


def test_a_proxy_with_the_class_of_a_map_is_no_map(hall):
    class Proxy:
        __class__ = cspace.CSpace

        def __getattr__(self, name):
            return getattr(hall, name)

        def motion_is_free(self, q0, q1):
            return False

    assert isinstance(Proxy(), cspace.CSpace)
    for call in (cspace.Gate, lambda space: planners.plan(space, (1.0, 1.0), (5.0, 1.0))):
        with pytest.raises(InputError, match="space is"):
            call(Proxy())


@pytest.mark.parametrize("periodic", [(True, False), [True, False], ("x",), ["x"]], ids=repr)
def test_an_angle_that_wraps_is_no_coordinate_of_a_pose(periodic):
    class Turning(Disc):
        periodic_axes = periodic

    space = Turning("x", "y")
    assert space.is_periodic == (True, False) and not space.has_poses
    assert planners.state_space(space).isCompound()
    plan = planners.plan(space, (-3.0, 1.5), (3.0, 1.6), seed=1)
    assert plan.certified and plan.length == pytest.approx(math.hypot(2.0 * math.pi - 6.0, 0.1))


def test_a_path_of_the_own_search_has_angles_beyond_the_bounds():
    class Found(Disc):
        periodic_axes = ("a",)
        searches = ("Own",)

        def search(self, name, endpoints, options):
            return np.array([endpoints[0], (-3.0, 1.5), endpoints[1]])

    assert planners.plan(Found("a", "b"), (-1.5, 1.5), (-1.4, 1.5)).certified


ZONE = shapely.box(2.5, 0.0, 3.5, 2.5)


class Zoned(cspace.Space):
    """A map with a zone that its reference point must not enter."""

    axes = ("x", "y")
    bounds = ((0.0, 0.0), (6.0, 4.0))

    def __init__(self, space):
        self.space = space

    def is_free(self, q):
        return self.motion_is_free(q, q)

    def motion_is_free(self, q0, q1):
        is_free = self.space.motion_is_free(q0, q1)
        return bool(is_free) and not shapely.LineString([q0, q1]).intersects(ZONE)


class Forwarding(Zoned):
    """A space that hands all other names on to the map."""

    def __getattr__(self, name):
        if name.startswith("__") or name == "space":
            raise AttributeError(name)
        return getattr(self.space, name)


@pytest.fixture(scope="module")
def hall():
    """Return the map of an empty hall."""
    return build_empty((60, 40), cspace.Robot.disc(0.2))


@pytest.mark.parametrize("kind", [Zoned, Forwarding])
def test_trajectories_keep_out_of_the_zone_of_a_space_that_wraps_a_map(hall, kind):
    space = kind(hall)
    for seed in range(3):
        plan = planners.plan(space, (1.0, 1.0), (5.0, 1.0), seed=seed)
        made = plan.trajectory(max_velocity=1.0, max_acceleration=0.3)
        rows = sample_evenly(made, 2000)[0]
        assert not shapely.intersects_xy(ZONE, rows).any()
        assert made.certified and made.recheck(space).all()
    # A trajectory of the map, whose curves are proven there, is not proven in the space.
    plan = planners.plan(hall, (1.0, 3.0), (5.0, 3.0), via=[(3.0, 2.6)])
    curved = plan.trajectory(max_velocity=1.0, max_acceleration=0.3)
    assert curved.recheck(hall).all() and not curved.recheck(space).all()


@pytest.mark.parametrize("kind", [Zoned, Forwarding])
def test_what_only_maps_and_arms_do_is_refused_for_a_space_that_wraps_a_map(hall, kind):
    plan = planners.plan(kind(hall), (1.0, 3.0), (5.0, 3.0))
    with pytest.raises(InputError, match=r"space .*proves"):
        cspace.Gate(kind(hall))
    with pytest.raises(InputError, match=r"plan .*explain"):
        plan.explain()
    with pytest.raises(InputError, match=r"plan .*drawn"):
        plan.plot()
    with pytest.raises(InputError, match=r"space .*drawn"):
        cspace.plot.animate(plan.space, plan, "never.gif")
    with pytest.raises(InputError, match=r"space .*arm"):
        planners.Trajectory.along(kind(hall), plan.path, max_acceleration=1.0)
    with pytest.raises(InputError, match=f"space is a {kind.__name__}; it must be a map"):
        cspace.lanes.audit(kind(hall), RouteGraph.from_arrays([(1, 1), (5, 1)], [(0, 1)]))


@pytest.mark.parametrize("name", ["classify", "is_free", "motion_is_free"])
def test_a_map_with_answers_of_its_own_is_refused_when_it_is_defined(hall, name):
    # Searches, edges and curves ask the map's kernels, which know nothing of such a method.
    with pytest.raises(
        InputError, match=f"has its own {name}; cells and geometry prove without them"
    ):
        type("Zoned", (cspace.CSpace,), {name: lambda self, *q: False})
    for answers in (type("Mixin", (), {name: lambda self, *q: False}), Zoned):
        if hasattr(answers, name):
            with pytest.raises(InputError, match=f"has its own .*{name}"):
                type("Mixed", (answers, cspace.CSpace), {})
    with pytest.raises(InputError, match=f"CSpace has its own {name}; cells and geometry"):
        setattr(hall, name, lambda *q: False)
    assert issubclass(type("Named", (cspace.CSpace,), {"label": "hall"}), cspace.CSpace)


def test_no_path_is_proven_only_if_every_start_is_apart_from_every_goal():
    """Places that were dropped because they are not proven free count, too."""
    space = Searched("a", "b")
    apart, inside, beside = (0.0, 1.95), (0.0, 0.5), (-1.5, 0.2)
    for goals in ([apart, GOAL], [GOAL, apart]):
        plan = planners.plan(space, START, goals)
        assert plan.certified and not plan.is_disconnected
        assert planners.plan(space, goals, START).certified
    assert planners.plan(space, [START, beside], apart).is_disconnected
    assert planners.plan(space, [START, beside], [apart, (0.1, 1.95)]).is_disconnected
    for start, goal in ((START, [apart, inside]), ([START, inside], apart)):
        assert not planners.plan(space, start, goal).is_disconnected
