"""
Smooth a path inside a proven corridor
======================================

``plan.corridor()`` gives convex sets along a path, each proven free for the shape of the robot. A
Bezier curve lies in the convex hull of its control points: if a region has all of them, it is free.
"""

import numpy as np
from scipy.optimize import LinearConstraint, minimize
from shapely import box

import cspace
import planners

# %%
# A depot with racks, and a robot that does not turn.

racks = [box(x, y, x + 1.2, y + 5) for x in (3, 7, 11) for y in (0.5 + x % 2, 8.5 - x % 4)]
depot = cspace.Workspace.from_polygons(racks, spacing=0.05, bounds=(0, 0, 16, 14))
space = cspace.build(depot, cspace.Robot.rectangle(0.7, 0.5))
plan = planners.plan(space, (1.0, 1.0), (15.0, 13.0))
corridor = plan.corridor(margin=1e-4)
print(plan.status, corridor)

# %%
# Six control points for each region, x and y, in one vector. They lie in the region; curves meet
# with the same velocity and acceleration; and the squared jerk is least.

ends = np.array([plan.start, *corridor.junctions, plan.goal])[:, np.newaxis]
steps = np.linspace(0.0, 1.0, 6)[:, np.newaxis]
guess = ends[:-1] + steps * np.diff(ends, axis=0)
points = np.eye(guess.size).reshape(*guess.shape, guess.size)
inside = [
    np.tensordot(region.A, part, (1, 1)).reshape(-1, guess.size)
    for region, part in zip(corridor.regions, points, strict=True)
]
limits = [np.repeat(region.b, 6) for region in corridor.regions]
meet = [np.diff(points, k, axis=1)[1:, 0] - np.diff(points, k, axis=1)[:-1, -1] for k in range(3)]
fixed = [points[0, 0], points[-1, -1], *np.concatenate(meet)]
values = [plan.start, plan.goal, *np.zeros((len(fixed) - 2, 2))]
weight = np.tensordot(np.diff(points, 3, axis=1), np.diff(points, 3, axis=1), ((0, 1, 2),) * 2)
result = minimize(
    lambda x: x @ weight @ x,
    guess.ravel(),
    jac=lambda x: 2.0 * weight @ x,
    method="SLSQP",
    constraints=[
        LinearConstraint(np.vstack(fixed), np.hstack(values), np.hstack(values)),
        LinearConstraint(np.vstack(inside), -np.inf, np.hstack(limits)),
    ],
)

# %% The curve, by its Bernstein polynomials. The map agrees that it is free.

t = np.linspace(0.0, 1.0, 50)[:, np.newaxis]
basis = np.array([1, 5, 10, 10, 5, 1]) * t ** np.arange(6) * (1.0 - t) ** np.arange(6)[::-1]
curve = np.concatenate(basis @ result.x.reshape(guess.shape))
print(f"{result.message}; free: {space.certify_path(curve).all()}")
corridor.plot(space.plot(path=curve)).figure.savefig("corridor_smoothing.png")
