"""Draws of places, plans, trajectories and movers of every kind, on maps of any_map."""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import shapely

import cspace
import planners
from cspace.lanes import Mover
from tests.helpers.any_map import build_map
from tests.helpers.drives import WORDS, make_drive

CLOCKS = (0.0, 1.7e9, 1.7e18)
"""Instants at which motions begin: of a test, and stamps in seconds and nanoseconds."""

KINDS = ("plane", "yaw", "yaw", "yaw", "space", "yaw in space")


class Drawn(NamedTuple):
    """A plan with its question."""

    space: Any
    start: Any
    goal: Any
    options: dict
    plan: planners.Plan


@cache
def build_room(kind, variant):
    """Build a map with few obstacle cells, and in the plane with a wall that has doors."""
    made = build_map(kind, "memory", "blocked", variant, None)
    occupied = made.occupied.copy()
    if made.dim == 2:
        wall = 12 + 4 * variant
        occupied[wall, :] = True
        if variant:
            occupied[wall, 6 : 6 + 9 * variant] = False
    return made.rebuild(occupied)


def draw_room(rng, kind=None):
    """Draw a map; in one of three the wall has no door."""
    return build_room(kind or str(rng.choice(KINDS)), int(rng.integers(3)))


def draw_place(rng, space, starts=False):
    """Draw a configuration, one with any yaw, a region, or the room around one."""
    q = space.sample_free(rng=rng)
    dim, kind = space.dim, rng.integers(7)
    if kind == 1 and space.size > dim:
        return (*q[:dim].tolist(), None)
    if kind == 2 and dim == 2:
        return shapely.Point(q[:2]).buffer(rng.uniform(0.2, 1.5))
    if kind == 3 and dim == 2 and space.size == 3:
        box = shapely.box(*(q[:2] - rng.uniform(0.1, 0.8, 2)), *(q[:2] + rng.uniform(0.1, 0.8, 2)))
        return box, float(q[2])
    if kind in (4, 5, 6):
        angle = float(rng.uniform(0.0, math.pi)) if space.size > dim else 0.0
        away = q + np.append(rng.uniform(-0.5, 0.5, dim), np.zeros(space.size - dim))
        is_closest = bool(kind == 6 and not starts)
        reach = float(rng.uniform(0.3, 3.0))
        return planners.Near(away, reach, angle, closest=is_closest)
    return q


def draw_places(rng, space, starts=False):
    """Draw a place, or a list of up to three."""
    places = [draw_place(rng, space, starts) for _ in range(int(rng.choice([1, 1, 2, 3])))]
    return places[0] if len(places) == 1 else places


def draw_question(rng, space, drive=None):
    """Draw start, goal and options of a plan with places of any kind."""
    via = [draw_places(rng, space) for _ in range(int(rng.choice([0, 0, 1, 2])))]
    options = {"via": via, "drive": drive, "seed": 1, "time_limit": 0.1}
    return draw_places(rng, space, starts=True), draw_places(rng, space), options


def draw_plan(rng, kind=None):
    """Draw a plan with a path: across a room, a short piece, a turn, a cusp or a rest."""
    while True:
        space = draw_room(rng, kind)
        word = str(rng.choice(WORDS)) if space.axes == ("x", "y", "yaw") else None
        free = space.sample_free(12, rng)
        start, goal = free[np.argsort(free[:, 0])[[0, -1]]]  # on both sides of the wall
        shape, dim = rng.integers(6), space.dim
        if shape == 1:  # a short piece
            goal = start + np.append(rng.normal(0.0, 0.03, dim), np.zeros(space.size - dim))
        elif shape == 2:  # a turn, or nothing
            goal = np.append(start[:dim], start[dim:] + rng.choice([0.0, 0.2, 2.0]))
        elif shape == 3 and dim == 2:  # behind it, for a cusp, or a place beside it
            goal = start + np.append(rng.uniform(-0.4, 0.4, dim), np.zeros(space.size - dim))
        options = {"drive": make_drive(word, 0.3), "seed": 1, "time_limit": 0.1}
        if rng.random() < 0.3:
            options["via"] = [space.sample_free(rng=rng)]
        if rng.random() < 0.3:
            options["planner"] = str(rng.choice(planners.choices(space).planners))
        try:
            plan = planners.plan(space, start, goal, **options)
        except cspace.CspaceError:  # the goal is not free, or the planner is for another drive
            continue
        if plan:
            return Drawn(space, start, goal, options, plan)


def draw_limits(rng, plan):
    """Draw the options of a trajectory, which may be slow, rest, or stop at corners."""
    limits = {"max_velocity": float(rng.uniform(0.3, 2.0)), "max_acceleration": 0.8}
    is_car = isinstance(plan.drive, planners.Car)
    if plan.space.rotations.names and not is_car:
        limits |= {"max_angular_velocity": 1.0, "max_angular_acceleration": 2.0}
    kind = rng.integers(7)
    if kind == 1:
        limits["max_jerk"] = 2.0
    elif kind == 2:
        limits["duration"] = 300.0
    elif kind == 3:
        limits["blend"] = False
    elif kind == 4:
        limits["stop_at_via"] = True
    elif kind == 5:
        limits["speed"] = planners.SlowNear(plan.space, 0.2, 0.3)
    return limits


def draw_movers(rng, space, motion):
    """Draw a robot on a motion, others around it, and options of their calls."""
    at = float(rng.choice(CLOCKS))
    dim = space.dim
    shape = "disc:0.2" if dim == 2 else "ball:0.2"
    begin, far = motion.positions[0][:dim], np.full(dim, 50.0)
    others = []
    for _ in range(int(rng.choice([0, 1, 1, 2, 4]))):
        kind = rng.integers(5)
        t = rng.uniform(0.0, motion.duration)
        place = motion.sample(t)[0][:dim]
        if kind == 0:  # far away
            others.append(Mover(shape, begin + far, at))
        elif kind == 1:  # beside the way, or in it
            others.append(Mover(shape, place + rng.uniform(-1.5, 1.5, dim)))
        elif kind == 2:  # crosses the way
            velocity = rng.normal(0.0, 0.5, dim)
            others.append(Mover(shape, place, at + t, velocity, error=0.02))
        elif kind == 3:  # follows
            others.append(Mover(space.robot, motion, at + rng.uniform(2.0, 20.0)))
        else:  # moves past the start
            others.append(Mover(shape, begin + 2.0, at, rng.normal(0.0, 0.5, dim), growth=0.001))
    until = at + 3.0 * motion.duration + 30.0
    options = {"margin": float(rng.choice([0.0, 0.1]))}
    moves = any(other.velocity is not None for other in others)
    if moves or rng.random() < 0.5:
        options["until"] = until
    return Mover(space.robot, motion, at), others, options
