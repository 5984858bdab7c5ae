"""Plans on the map whose MIXED cells the geometry decides."""

import pickle

import pytest
import shapely

import planners
from cspace import Robot
from tests.helpers.slits import SLIT, build_slit

START, GOAL = (0.5, 1.2), (1.9, 1.2)
DISC = Robot.disc(0.2)


def test_a_plan_on_the_exact_map_passes_where_cells_do_not():
    space = build_slit(DISC, None)
    assert not planners.plan(space, START, GOAL)
    for name in (None, "RRTConnect"):
        plan = planners.plan(space.exact, START, GOAL, planner=name, seed=1)
        assert plan.certified and plan.exact and plan.space is space.exact
        path = shapely.LineString(plan.waypoints)
        assert path.distance(shapely.union_all(SLIT)) >= 0.2 - 1e-9
        assert plan.recheck().all() and plan.recheck(build_slit(DISC, None)).all()
        gap = path.distance(shapely.union_all(SLIT)) - 0.2
        assert plan.clearance == 0.0 and 0.0 <= plan.obstacle_distance <= gap + 1e-9
        trajectory = plan.trajectory(max_velocity=1.0, max_acceleration=1.0)
        assert trajectory.certified and trajectory.recheck(plan.space).all()
        assert pickle.loads(pickle.dumps(plan)).exact
    space.add_obstacle("crate", shapely.box(1.1, 1.1, 1.2, 1.3))
    assert not plan.recheck().all()


@pytest.mark.parametrize("view", [False, True])
def test_the_setup_of_ompl_asks_the_geometry(view):
    space = build_slit(DISC, None)
    asked = space.exact if view else space

    def ask(q0, q1):
        si = planners.simple_setup(asked).getSpaceInformation()
        states = si.allocState(), si.allocState()
        for state, q in zip(states, (q0, q1), strict=True):
            state[0], state[1] = q
        return si.isValid(states[0]), si.checkMotion(*states)

    assert ask((1.15, 1.19), GOAL) == (view, view)


@pytest.mark.parametrize(
    "drive", [planners.Car(turning_radius=0.5, reverse=True), planners.Differential()]
)
def test_drives_plan_on_the_exact_map(drive):
    space = build_slit(Robot.rectangle(0.3, 0.38))
    start, goal = (*START, 0.0), (*GOAL, 0.0)
    assert not planners.plan(space, start, goal, drive=drive, time_limit=0.2)
    plan = planners.plan(space.exact, start, goal, drive=drive)
    assert plan.certified and plan.exact and plan.recheck().all()
