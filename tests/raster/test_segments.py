"""Rasters in the plane, against exact rational arithmetic and shapely."""

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace._rotations import RotationCell
from cspace._shapes import Balls
from tests.helpers import oracles
from tests.helpers.placements import ORACLE_BAND
from tests.helpers.strategies import examples, robots


def check_between(cells, low, high):
    """Fail unless a raster has the required offsets only."""
    assert low <= cells, f"missing {sorted(low - cells)[:5]}"
    assert cells <= high, f"too many {sorted(cells - high)[:5]}"


@examples(40)
@given(
    robots(),
    st.sampled_from([0.1, 0.25, 0.37]),
    st.sampled_from([0.0, 0.25]),
    st.just(0.0) | st.floats(-7, 7),
)
def test_rasters_of_rotated_robots_agree_with_shapely(robot, spacing, margin, yaw):
    matrix = Rotation.from_rotvec([0, 0, yaw]).as_matrix()[:2, :2]
    outer, inner = robot.shape.rasters(spacing, margin, RotationCell(matrix, 0.0, about_z=True))
    offsets = np.stack(np.meshgrid(*(np.arange(-30, 31),) * 2, indexing="ij"), axis=-1)
    low = (offsets - 1) * spacing
    high = (offsets + 1) * spacing
    boxes = shapely.box(low[..., 0], low[..., 1], high[..., 0], high[..., 1])
    points = shapely.points(offsets * spacing)
    if isinstance(robot.shape, Balls):
        centers = shapely.points(robot.shape.centers @ matrix.T)[:, None, None]
        radii = robot.shape.radii[:, None, None]
        gap = (shapely.distance(boxes, centers) - radii).min(axis=0)
        depth = (shapely.distance(points, centers) - radii).min(axis=0)
    else:
        parts = getattr(robot.shape, "geometries", [robot.geometry])
        turned = shapely.transform(parts, lambda corners: corners @ matrix.T)[:, None, None]
        gap = shapely.distance(boxes, turned).min(axis=0)
        border = shapely.distance(points, shapely.boundary(turned))
        depth = np.where(shapely.intersects(turned, points), -border, border).min(axis=0)
    for raster, must, may in (
        (outer, (gap == 0.0) | (gap <= margin - 1e-9), gap <= margin + ORACLE_BAND),
        (inner, depth < -ORACLE_BAND, depth <= 1e-9),
    ):
        members = {m for m in oracles.raster_offsets(raster) if max(map(abs, m)) <= 30}
        required, allowed = ({tuple(m) for m in offsets[which].tolist()} for which in (must, may))
        check_between(members, required, allowed)
