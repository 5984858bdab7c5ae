"""
Pull the path of an arm out of obstacles
========================================

An arm of five links slides into a channel that leaves 2 cm to each side. RRTConnect finds no path
in five seconds, and one in fourteen with another seed. The straight motion of the joints collides,
but ``cspace.arms.ArmPenetration`` tells how deep, with the derivatives by all joints, so that an
optimizer pulls it out in about as long. The field proves nothing; the space of the arm then proves
the path, whatever the field missed.

It needs the extra ``spectral``.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

import cspace
import planners
from cspace.arms import ArmPenetration, PosedShape
from cspace.spectral import decompose

# %% Bars of 30 cm, 4 cm wide, whose joints rotate about z, and two blocks with a channel of 8 cm
# between them.

LINKS, LENGTH, WIDTH = 5, 0.3, 0.04
parts = ['<link name="foot"/>']
for n in range(LINKS):
    parent, x = (f"bar{n - 1}", LENGTH) if n else ("foot", 0)
    parts.append(
        f'<link name="bar{n}"><collision><origin xyz="{LENGTH / 2} 0 0"/>'
        f'<geometry><box size="{LENGTH} {WIDTH} {WIDTH}"/></geometry></collision></link>'
        f'<joint name="joint{n}" type="revolute"><parent link="{parent}"/><child link="bar{n}"/>'
        f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    )
Path("snake.urdf").write_text(f'<robot name="snake">{"".join(parts)}</robot>')
arm = cspace.Arm.from_urdf("snake.urdf")

block, places = (
    cspace.Robot.box((0.7, 0.4, 0.1)).shape,
    np.array([[1.19, 0.24, 0.0], [1.19, -0.24, 0.0]]),
)
poses = [np.vstack([np.column_stack([np.eye(3), place]), [0.0, 0.0, 0.0, 1.0]]) for place in places]
space = cspace.build_arm_space(
    {f"block{n}": PosedShape(block, pose) for n, pose in enumerate(poses)}, arm
)

zigzag = 1.15 * (-1.0) ** np.arange(LINKS)  # directions of the links
zigzag[-1] = 0.0
start, goal = np.diff(zigzag, prepend=0.0), np.zeros(LINKS)

# %%
# Sampling alone, for five seconds.

plan = planners.plan(space, start, goal, planner="RRTConnect", time_limit=5.0, seed=1)
print(f"RRTConnect: {'solved' if plan else 'no path'}")

# %%
# Balls that cover a bar, and balls that cover the blocks.

bar = np.linspace(0.01, LENGTH - 0.01, 15)[:, None] * [1.0, 0.0, 0.0], np.full(15, 0.0301)
cover = decompose(block, kind="outer", tolerance=0.01)
blocks = (
    np.concatenate([cover.centers + place for place in places]),
    np.tile(cover.radii, len(places)),
)
penetration = ArmPenetration(arm, {f"bar{n}": bar for n in range(LINKS)}, blocks)

# %% The cost of a path is the sum of its squared steps, and of the penetration at eight samples of
# each step. Long steps cost more than their square, because they could leap across a block from one
# sample to the next.

WAYPOINTS, SAMPLES, LONG = 18, 8, 1000
shares = np.arange(SAMPLES * (WAYPOINTS + 1) + 1) / SAMPLES
weights = np.stack(
    [np.interp(shares, np.arange(WAYPOINTS + 2), row) for row in np.eye(WAYPOINTS + 2)], axis=1
)


def path_of(x):
    return np.vstack([start, x.reshape(WAYPOINTS, LINKS), goal])


def cost(x, weight):
    path = path_of(x)
    steps = np.diff(path, axis=0)
    values, slopes = penetration.value_and_gradient(weights @ path)
    gradient = weight * weights.T @ slopes
    squares = (steps**2).sum(axis=1, keepdims=True)
    pulls = 2.0 * steps * (1.0 + 4.0 * LONG * squares**3)
    gradient[1:] += pulls
    gradient[:-1] -= pulls
    return (squares + LONG * squares**4).sum() + weight * values.sum(), gradient[1:-1].ravel()


# The weight of the penetration rises, because a heavy one at once would fling the path away.
straight = np.linspace(start, goal, WAYPOINTS + 2)
x, limits = straight[1:-1].ravel(), [(-2.9, 2.9)] * (WAYPOINTS * LINKS)
for weight in (1e3, 1e4, 1e5, 1e6):
    found = minimize(
        cost, x, (weight,), jac=True, method="L-BFGS-B", bounds=limits, options={"maxiter": 80}
    )
    x, penetrations = found.x, penetration.value_and_gradient(weights @ path_of(found.x))[0]
    print(f"weight {weight:.0e}: {found.nit} steps, penetration {penetrations.sum():.1e} m³")
path = path_of(x)

# %%
# The proof comes from the geometry of the links, for every motion along its whole length.

for name, each in (("straight", straight), ("pulled", path)):
    print(f"{name}: {space.certify_path(each).sum()} of {len(each) - 1} motions are proven free")

# %%
# Both paths at six moments, blue where FREE is proven, red elsewhere.

figure, axes = plt.subplots(2, 1, figsize=(8, 8), layout="constrained", sharex=True)
for ax, name, each in zip(
    axes,
    ("straight motion of the joints", "pulled by the gradient, and proven"),
    (straight, path),
    strict=True,
):
    for x, y, _ in places:
        ax.add_patch(plt.Rectangle((x - 0.35, y - 0.2), 0.7, 0.4, color="#8c8c8c"))
    for n in np.linspace(0, len(each) - 1, 6).astype(int):
        bends = [arm.pose(each[n], f"bar{k}")[:2, 3] for k in range(LINKS)]
        tip = arm.pose(each[n], f"bar{LINKS - 1}") @ [LENGTH, 0.0, 0.0, 1.0]
        color = "#0072b2" if space.is_free(each[n]) else "#d55e00"
        ax.plot(
            *np.array([*bends, tip[:2]]).T,
            "o-",
            color=color,
            alpha=0.25 + 0.1 * n / 3,
            linewidth=3,
            markersize=3,
        )
    ax.set(title=name, ylabel="y (m)", aspect="equal", ylim=(-0.5, 0.5))
axes[1].set(xlabel="x (m)")
figure.savefig("pull_arm.png")
plt.close(figure)
print("wrote pull_arm.png")
