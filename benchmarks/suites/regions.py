"""Convex regions of FREE cells: times, volumes and coverage, beside Drake's IRIS."""

from __future__ import annotations

import logging
import time
from functools import partial
from typing import Any

import numpy as np
import shapely

import cspace
import planners
from benchmarks.inputs import NO_DATA, boxes, data_folder, real_map
from benchmarks.report import Report
from benchmarks.timing import Timing, once
from cspace import CSpace, Robot, Workspace
from cspace._support.arrays import FREE, Floats
from cspace.regions import ConvexRegion

REACH = 5.0
"""Half the side of the box around each seed, metres."""

SEEDS = 50
"""Number of seeds of each case."""

SAMPLES = 100_000
"""Number of configurations drawn in all regions of a method."""

DEPOT_ROBOT = (0.7, 0.5)
"""Sides of the robot in the depot, metres."""


def run(report: Report, seed: int) -> None:
    """Time regions, corridors and covers; compare volumes, coverage and collisions with Drake's."""
    rng = np.random.default_rng(seed)
    _time_regions(report, rng)
    workspace = real_map("maps/depot.yaml") if data_folder() else None
    if workspace is None:
        report.note(NO_DATA)
        workspace = Workspace.from_array(boxes(400, 0.2, rng), 0.05)
    _time_paths(report, workspace, rng)
    if report.has("pydrake", "no comparison"):
        _compare_with_drake(report, workspace, rng)


def _time_regions(report: Report, rng: np.random.Generator) -> None:
    """Time regions on random maps, and their growth with the cells within reach."""
    plane, solid = (400, 64) if report.quick else (1000, 256)
    flat = Workspace.from_array(boxes(plane, 0.2, rng), 0.05)
    space = cspace.build(flat, Robot.disc(0.2))
    turning = cspace.build(flat, Robot.rectangle(*DEPOT_ROBOT), rotations=72)
    voxels = Workspace.from_array(boxes(solid, 0.15, rng, 3), 0.1)
    flying = cspace.build(voxels, Robot.ball(0.2))
    width = np.radians(4 * 5.0 - 0.1)  # meets five cells of 5 degrees
    cases: list[tuple[str, CSpace, dict[str, float], float]] = [
        (f"(x, y), {plane}^2", space, {}, 6e-3),
        (f"(x, y, yaw), {plane}^2, 5 yaw slices", turning, {"yaw_width": width}, 12e-3),
        (f"(x, y, z), {solid}^3", flying, {}, 60e-3),
        (f"(x, y), {plane}^2, half the reach", space, {"reach": REACH / 2}, 6e-3),
        (f"(x, y, z), {solid}^3, half the reach", flying, {"reach": REACH / 2}, 60e-3),
    ]
    for name, each, options, most in cases:
        report.section(f"regions of {name}")
        timing = Timing(None)
        for q in _draw_seeds(each, options, rng):
            timing.take(partial(each.free_region, q, **{"reach": REACH} | options))
        report.timing("free_region", timing)
        report.figure("median CPU time", 1e3 * timing.median_cpu, "ms", most=1e3 * most)


def _draw_seeds(space: CSpace, options: dict[str, float], rng: np.random.Generator) -> list[Floats]:
    """Draw configurations that have a region."""
    seeds = list[Floats]()
    while len(seeds) < SEEDS:
        (q,) = space.sample_free(1, rng=rng)
        try:
            space.free_region(q, reach=0.5, **{k: v for k, v in options.items() if k != "reach"})
        except cspace.InputError:  # not FREE at all yaws
            continue
        seeds.append(q)
    return seeds


def _time_paths(report: Report, workspace: Workspace, rng: np.random.Generator) -> None:
    """Time corridors along plans, and a cover of the map."""
    report.section("the depot: corridors, and a cover of nine tenths")
    space = cspace.build(workspace, Robot.rectangle(*DEPOT_ROBOT))
    per_metre = list[float]()
    while len(per_metre) < (5 if report.quick else 20):
        plan = planners.plan(space, *space.sample_free(2, rng=rng))
        if plan and plan.length > 5.0:
            timing = once(plan.corridor)
            per_metre.append(timing.median_cpu / plan.length)
    report.figure(
        "CPU time of a corridor of 50 m", 50e3 * float(np.median(per_metre)), "ms", most=60.0
    )
    cover = once(space.free_regions)
    report.timing("free_regions", cover, regions=len(cover.value.regions))
    report.figure("CPU time of free_regions", cover.median_cpu, "s", most=3.0)
    report.check(cover.value.coverage >= 0.9, "nine tenths are covered")


def _compare_with_drake(report: Report, workspace: Workspace, rng: np.random.Generator) -> None:
    """Compare regions with those of Drake's Iris on the same cells, and IrisZo on the scene."""
    from pydrake.geometry.optimization import HPolyhedron, Hyperrectangle, Iris, IrisOptions

    logging.getLogger("drake").setLevel(logging.WARNING)
    report.section("the depot: Drake's Iris, cells as boxes, and IrisZo, the scene itself")
    space = cspace.build(workspace, Robot.rectangle(*DEPOT_ROBOT))
    occupied = [
        shapely.box(*corner, *(corner + workspace.grid.spacing))
        for corner in np.asarray(workspace.grid.lower)
        + workspace.grid.spacing * np.argwhere(workspace.outer)
    ]
    tree = shapely.STRtree(occupied)
    options = IrisOptions()
    options.require_sample_point_is_contained = True
    count = 5 if report.quick else SEEDS
    timings = {name: Timing(None) for name in ("ours", "Iris", "IrisZo")}
    regions: dict[str, list[ConvexRegion]] = {name: [] for name in timings}
    zeroth_order = _ZeroOrder(tree)
    for q in space.sample_free(count, rng=rng):
        ours = timings["ours"].take(partial(space.free_region, q, reach=REACH))
        low = np.maximum(q - REACH, space.grid.lower)
        high = np.minimum(q + REACH, space.grid.upper)
        domain = HPolyhedron.MakeBox(low, high)
        cells = [Hyperrectangle(*corners) for corners in _list_cells(space, low, high)]
        theirs = timings["Iris"].take(partial(Iris, cells, q, domain, options))
        sampled = timings["IrisZo"].take(partial(zeroth_order.grow, q, domain))
        regions["ours"].append(ours)
        regions["Iris"].append(ConvexRegion(theirs.A(), theirs.b(), space.axes))
        regions["IrisZo"].append(ConvexRegion(sampled.A(), sampled.b(), space.axes))
    report.timings(timings)
    volumes = {name: np.array([each.volume for each in found]) for name, found in regions.items()}
    centers = space.grid.center_of(np.argwhere(np.asarray(space.cell_states) == FREE))
    for name, found in regions.items():
        inside = np.any([region.contains(centers) for region in found], axis=0)
        report.figure(f"median volume, {name}", float(np.median(volumes[name])), "m2")
        report.figure(f"FREE cells covered, {name}", float(inside.mean()), "")
        drawn = np.concatenate([_draw_inside(region, SAMPLES // count, rng) for region in found])
        hits = _count_collisions(tree, drawn)
        report.figure(f"samples in collision of {len(drawn)}, {name}", hits, "")
        if name == "ours":
            report.check(hits == 0, "no sample of ours is in collision")
    ratio = float(np.median(volumes["ours"] / volumes["Iris"]))
    report.figure("volume over that of Iris, median of pairs", ratio, "x", least=0.95)


def _list_cells(space: CSpace, low: Floats, high: Floats) -> list[tuple[Floats, Floats]]:
    """Return the corners of the cells in a box that are not FREE and have a FREE neighbour."""
    from cspace.regions._free_region import find_surface

    first, last = space.grid.cell_of([low, high])
    taken = np.asarray(space.cell_states)[tuple(map(slice, first, last + 1))] != FREE
    corners = space.grid.lower + space.grid.spacing * (first + find_surface(taken))
    return [(corner, corner + space.grid.spacing) for corner in corners]


class _ZeroOrder:
    """Drake's IrisZo in a scene of boxes, with the robot as a box that slides along x and y."""

    def __init__(self, tree: shapely.STRtree) -> None:
        """Build the plant: the occupied cells, merged, and the robot."""
        from pydrake.geometry import Box
        from pydrake.math import RigidTransform
        from pydrake.multibody.plant import CoulombFriction
        from pydrake.multibody.tree import PrismaticJoint, SpatialInertia
        from pydrake.planning import RobotDiagramBuilder, SceneGraphCollisionChecker

        builder = RobotDiagramBuilder()
        plant = builder.plant()
        friction = CoulombFriction(0.5, 0.5)
        model = plant.AddModelInstance("robot")
        inertia = SpatialInertia.SolidBoxWithMass(1.0, 1.0, 1.0, 1.0)
        slider, body = (plant.AddRigidBody(name, model, inertia) for name in ("slider", "body"))
        self._joints = [
            plant.AddJoint(
                PrismaticJoint("x", plant.world_frame(), slider.body_frame(), [1, 0, 0])
            ),
            plant.AddJoint(PrismaticJoint("y", slider.body_frame(), body.body_frame(), [0, 1, 0])),
        ]
        shape = Box(*DEPOT_ROBOT, 1.0)
        plant.RegisterCollisionGeometry(body, RigidTransform(), shape, "body", friction)
        merged = shapely.union_all(tree.geometries)
        rows = _merge_rows(merged, tree)
        for k, (low, high) in enumerate(rows):
            pose = RigidTransform([*(0.5 * (low + high)), 0.0])
            box = Box(*(high - low), 1.0)
            plant.RegisterCollisionGeometry(plant.world_body(), pose, box, f"cell{k}", friction)
        limits = np.array(merged.bounds).reshape(2, 2)
        for joint, low, high in zip(self._joints, *limits, strict=True):
            joint.set_position_limits([low - 1.0], [high + 1.0])
        self._checker = SceneGraphCollisionChecker(
            model=builder.Build(), robot_model_instances=[model], edge_step_size=0.05
        )

    def grow(self, q: Floats, domain: Any) -> Any:
        """Return the region of IrisZo around a seed."""
        from pydrake.geometry.optimization import Hyperellipsoid
        from pydrake.planning import IrisZo, IrisZoOptions

        ball = Hyperellipsoid.MakeHypersphere(1e-2, q)
        return IrisZo(self._checker, ball, domain, IrisZoOptions())


def _merge_rows(merged: Any, tree: shapely.STRtree) -> list[tuple[Floats, Floats]]:
    """Return corners of boxes that cover the cells of a tree: runs along y, merged along x."""
    bounds = shapely.bounds(tree.geometries)
    side = float((bounds[:, 2] - bounds[:, 0]).min())
    origin = np.array(merged.bounds[:2])
    cells = np.rint((bounds[:, :2] - origin) / side).astype(np.int64)
    occupied = np.zeros(cells.max(axis=0) + 1, dtype=np.bool_)
    occupied[tuple(cells.T)] = True
    from benchmarks.inputs import merge_cells

    boxes = merge_cells(occupied[:, :, np.newaxis])[:, :, :2]
    return [(origin + side * first, origin + side * stop) for first, stop in boxes]


def _draw_inside(region: ConvexRegion, count: int, rng: np.random.Generator) -> Floats:
    """Draw configurations evenly in a region, by rejection."""
    low, high = region.bounds
    drawn = np.empty((0, len(low)))
    until = time.monotonic() + 10.0
    while len(drawn) < count and time.monotonic() < until:
        q = rng.uniform(low, high, (2 * count, len(low)))
        drawn = np.concatenate([drawn, q[region.contains(q)]])
    return drawn[:count]


def _count_collisions(tree: shapely.STRtree, positions: Floats) -> int:
    """Count the positions at which the robot overlaps an occupied cell, by shapely."""
    half = 0.5 * np.array(DEPOT_ROBOT)
    bodies = shapely.box(*(positions - half).T, *(positions + half).T)
    return len(np.unique(tree.query(bodies, "intersects")[0]))
