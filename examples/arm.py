"""
An arm of two links: what it may do, and a path that is proven
==============================================================

``cspace.Arm`` reads a robot with joints from a URDF, and ``cspace.build_arm`` puts it among obstacles. Configurations
are then FREE, BLOCKED or MIXED, and a whole motion of the joints is proven free in one call. Here a roadmap of proven
motions gives the way around a post.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import cspace
from cspace.arms import Placed

# %%
# Two bars of 1 m on a foot, as people write them down. Both joints turn about z.

bar = '<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>'
joint = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)
Path("two.urdf").write_text(
    f'<robot name="two"><link name="foot"/><link name="upper">{bar}</link><link name="fore">{bar}</link>'
    + joint.format("shoulder", "foot", "upper", 0)
    + joint.format("elbow", "upper", "fore", 1)
    + "</robot>"
)
arm = cspace.Arm.from_urdf("two.urdf")


# %%
# Two posts and a wall. What is nearest to touching has a name.


def at(x, y):
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return pose


obstacles = {
    "left post": Placed(cspace.Robot.cylinder(0.15, 1.0).shape, at(0.3, 1.3)),
    "right post": Placed(cspace.Robot.cylinder(0.2, 1.0).shape, at(1.3, 0.9)),
    "wall": Placed(cspace.Robot.box((4.0, 0.1, 1.0)).shape, at(0.0, -1.4)),
}
space = cspace.build_arm(obstacles, arm)
start, goal = np.array([-0.2, 0.4]), np.array([2.6, -0.4])
contact = space.closest(start)
print(f"at the start, {contact.link!r} is nearest to {contact.other!r}: {contact.distance:.2f} m")
print(f"straight from start to goal: {'proven free' if space.motion_is_free(start, goal) else 'not free'}")

# %%
# The configuration space: a look at every degree and a half.

angles = np.linspace(-3.0, 3.0, 240)
states = np.asarray(space.classify(np.stack(np.meshgrid(angles, angles, indexing="ij"), axis=-1)))

# %%
# A roadmap: FREE configurations of a lattice, joined to their neighbours by motions that are proven all along.

lattice = np.stack(np.meshgrid(*[np.linspace(-3.0, 3.0, 41)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
nodes = np.vstack([start, goal, lattice])
near = np.abs(nodes[:, None] - nodes).max(axis=-1) < 0.16
first, second = np.nonzero(np.triu(near, 1))
proven = space.motion_is_free(nodes[first], nodes[second])
first, second = first[proven], second[proven]
lengths = np.linalg.norm(nodes[first] - nodes[second], axis=1)
roadmap = coo_array((lengths, (first, second)), shape=(len(nodes), len(nodes)))
_, before = dijkstra(roadmap, directed=False, indices=0, return_predecessors=True)
way = [1]
while way[-1] != 0:
    way.append(int(before[way[-1]]))
path = nodes[way[::-1]]
print(f"a path of {len(path)} waypoints, certified: {space.certify_path(path).all()}")

# %%
# Left the arm along its path, right the same path in the configuration space.

figure, (world, joints) = plt.subplots(1, 2, figsize=(11, 5.2), layout="constrained")
for x, y, radius in ((0.3, 1.3, 0.15), (1.3, 0.9, 0.2)):
    world.add_patch(plt.Circle((x, y), radius, color="#262626"))
world.add_patch(plt.Rectangle((-2.0, -1.45), 4.0, 0.1, color="#262626"))
shown = np.linspace(0, len(path) - 1, 14).astype(int)
for number, (shoulder, elbow) in enumerate(path[shown]):
    tip = np.cumsum([[0, 0], *([[np.cos(a), np.sin(a)] for a in (shoulder, shoulder + elbow)])], axis=0)
    last = number in (0, len(shown) - 1)
    world.plot(*tip.T, "-o", color="#009e73", alpha=1.0 if last else 0.35, linewidth=3.0, markersize=4.0)
world.set(
    aspect="equal", xlabel="x (m)", ylabel="y (m)", title="the arm on its way", xlim=(-2.1, 2.1), ylim=(-1.6, 2.1)
)
colors = ListedColormap(["#ffffff", "#d55e00", "#a6d3ee"])  # FREE, MIXED, BLOCKED
joints.pcolormesh(angles, angles, states.T, cmap=colors, vmin=0, vmax=2)
joints.plot(*path.T, color="#0072b2", linewidth=2.0)
joints.plot(*start, "o", color="white", mec="black")
joints.plot(*goal, "*", color="#cc79a7", mec="black", markersize=12)
joints.set(
    aspect="equal", xlabel="shoulder (rad)", ylabel="elbow (rad)", title="FREE white, BLOCKED blue, MIXED orange"
)
figure.savefig("arm.png", dpi=110)
