"""A slit that only the geometry decides."""

import numpy as np
import shapely

import cspace
from cspace import Robot, Workspace
from tests.helpers.handmade import configurations
from tests.helpers.placements import draw_near_mixed

SLIT = [shapely.box(1.0, 0.0, 1.3, 0.97), shapely.box(1.0, 1.41, 1.3, 2.4)]
"""Walls with a slit, which cells of 0.1 m leave undecided for a robot 0.4 m wide."""

RECTANGLE = Robot.rectangle(0.6, 0.4)


def build_slit(robot=RECTANGLE, rotations=24, **options):
    workspace = Workspace.from_polygons(SLIT, 0.1, (0.0, 0.0, 2.4, 2.4))
    return cspace.build(workspace, robot, rotations=rotations, **options)


def draw_rows(space, seed, count=300):
    """Draw configurations near MIXED cells, and others beside them."""
    rng = np.random.default_rng(seed)
    q = draw_near_mixed(space, rng, count, around=0.1)
    return q, configurations(space, q + rng.normal(0.0, 0.1, q.shape))


def draw_only_exact(space):
    """Draw configurations in MIXED cells that the geometry proves free."""
    q, _ = draw_rows(space, 5)
    return q[space.exact.is_free(q) & ~np.asarray(space.is_free(q))]
