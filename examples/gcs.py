"""
A fastest trajectory through a graph of convex sets
===================================================

Drake's ``GcsTrajectoryOptimization`` finds a smooth trajectory through a graph of convex sets.
``space.free_regions`` makes the sets and the graph, in seconds, and each is proven free for the
shape of the robot. Needs ``pip install drake``; without it, the script draws the regions alone.

References
----------
T. Marcucci, M. Petersen, D. von Wrangel and R. Tedrake, "Motion planning around obstacles with
convex optimization", 2023.
"""

from importlib.util import find_spec

import numpy as np
import shapely
from shapely import affinity, box

import cspace

# %%
# A depot with racks. Solvers obey their constraints within some 1e-6, so regions keep a margin.

racks = [box(x, y, x + 1.2, y + 5) for x in (3, 7, 11) for y in (0.5 + x % 2, 8.5 - x % 4)]
depot = cspace.Workspace.from_polygons(racks, spacing=0.05, bounds=(0, 0, 16, 14))
space = cspace.build(depot, cspace.Robot.rectangle(0.7, 0.5))
cover = space.free_regions(0.95, margin=1e-3, reach=8.0)
print(cover)
axes = cover.plot(space.plot(), linewidth=0.5)

# %%
# The least time from corner to corner at 1 m/s along each axis, with a continuous acceleration.


def find_fastest(start: tuple[float, float], goal: tuple[float, float]) -> np.ndarray:
    """Return rows of the fastest trajectory, shape (n, 2), metres."""
    from pydrake.geometry.optimization import GraphOfConvexSetsOptions, HPolyhedron, Point
    from pydrake.planning import GcsTrajectoryOptimization

    gcs = GcsTrajectoryOptimization(2)
    sets = [HPolyhedron(region.A, region.b) for region in cover.regions]
    edges = [*cover.graph, *(pair[::-1] for pair in cover.graph)]
    regions = gcs.AddRegions(sets, edges, 6, 0.01, 20.0, "free")
    first = gcs.AddRegions([Point(start)], 0, name="start")
    last = gcs.AddRegions([Point(goal)], 0, name="goal")
    gcs.AddEdges(first, regions)
    gcs.AddEdges(regions, last)
    gcs.AddTimeCost()
    gcs.AddPathLengthCost(0.01)
    gcs.AddVelocityBounds([-1.0, -1.0], [1.0, 1.0])
    gcs.AddPathContinuityConstraints(1)
    gcs.AddPathContinuityConstraints(2)
    options = GraphOfConvexSetsOptions()
    options.convex_relaxation = True
    options.max_rounded_paths = 10
    trajectory, result = gcs.SolvePath(first, last, options)
    if not result.is_success():
        raise SystemExit("Drake found no trajectory")
    times = np.linspace(trajectory.start_time(), trajectory.end_time(), 2000)
    print(f"{times[-1] - times[0]:.2f} s")
    return trajectory.vector_values(times).T


# %%
# The map proves the motion through all rows, and shapely finds no collision.

if find_spec("pydrake") is not None:
    rows = find_fastest((1.0, 1.0), (15.0, 13.0))
    body = box(-0.35, -0.25, 0.35, 0.25)
    placed = shapely.union_all([affinity.translate(body, x, y) for x, y in rows[::10]])
    print(f"proven free: {space.certify_path(rows).all()}")
    print(f"collisions by shapely: {placed.intersects(shapely.union_all(racks))}")
    axes.plot(*rows.T, color="black", linewidth=2.0)
axes.figure.savefig("gcs.png")
