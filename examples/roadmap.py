"""
A custom roadmap
================

The map samples FREE configurations and proves thousands of edges in one call. A probabilistic
roadmap (Kavraki and others, 1996) needs no more; scipy finds the shortest path in it, without a
planner.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from shapely import Point, box

import cspace

walls = [box(5.0, 0.0, 5.15, 7.0), box(11.0, 0.0, 11.15, 4.4), box(11.0, 5.7, 11.15, 10.0)]
tables = [Point(8.0, 6.6).buffer(0.9), Point(13.2, 3.4).buffer(0.7)]
room = cspace.Workspace.from_polygons([*walls, *tables], 0.05, bounds=(0, 0, 16, 10))
space = cspace.build(room, cspace.Robot.disc(0.3))

# %% Vertices are sampled evenly from the FREE cells. The first and the last are start and goal; the
# requested start is inside a table, so the nearest FREE configuration replaces it.

start, goal = space.nearest_free((13.2, 3.4)), (1.4, 8.6)
vertices = np.vstack([start, space.sample_free(1200, np.random.default_rng(3)), goal])
print(f"start: {start}")

# %%
# Each vertex is connected to its twenty nearest neighbours if the edge is proven free.

_, near = cKDTree(vertices).query(vertices, k=21)
edges = np.column_stack([np.repeat(np.arange(len(vertices)), 20), near[:, 1:].ravel()])
edges = edges[space.certify_path(vertices, edges)]
print(f"{len(edges)} of {20 * len(vertices)} edges are free all along")

# %%
# The shortest path in the roadmap.

lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
graph = coo_array((lengths, edges.T), shape=2 * (len(vertices),)).tocsr()
distances, before = dijkstra(graph, directed=False, indices=0, return_predecessors=True)
path = [len(vertices) - 1]
while path[-1] != 0:
    path.append(before[path[-1]])
print(f"{distances[-1]:.2f} m, certified: {space.certify_path(vertices[path]).all()}")

figure, ax = plt.subplots(figsize=(8, 5.5), layout="constrained")
space.plot(ax=ax, path=vertices[path[::-1]], legend=False)
ax.add_collection(LineCollection(vertices[edges], colors="0.6", linewidths=0.5))
figure.savefig("roadmap.png")
plt.close(figure)
print("wrote roadmap.png")
