"""Memory checks before any work."""

import pytest

import cspace
from cspace._engines.slices import estimate_raster_bytes, slice_rasters
from cspace._support.limits import (
    RASTER_CELL_BYTES,
    SLICE_BYTES,
    check_memory,
)


def test_work_beyond_memory_is_refused_with_a_spacing_that_fits(monkeypatch):
    monkeypatch.setattr("cspace._support.limits.free_bytes", lambda: 10**9)
    check_memory(0.95e9, "the map", cspace.Grid((0.0,) * 3, 0.1, (1000,) * 3))
    with pytest.raises(cspace.InputError, match="at most 950 MB may be used, 95%"):
        check_memory(1e9, "the map", cspace.Grid((0.0,) * 3, 0.1, (1000,) * 3))


@pytest.mark.parametrize(
    "robot, rotations, spacing",
    [
        (cspace.Robot.rectangle(3.0, 1.5, (0.3, 0.05)), cspace.Rotations.of(500), 0.1),
        (cspace.Robot.rectangle(4.0, 0.1), cspace.Rotations.of(501), 0.1),
        (
            cspace.Robot.box((0.3, 0.18, 0.15), (0.03, 0.02, 0.01)),
            cspace.Rotations.quaternions(4),
            0.1,
        ),
        (cspace.Robot.box((1.0, 0.6, 0.5), (0.03, 0.02, 0.01)), cspace.Rotations.of(40), 0.1),
    ],
    ids=["car", "bar", "small box", "box"],
)
def test_the_memory_estimate_of_rasters_is_near_the_measurement(robot, rotations, spacing):
    pairs = slice_rasters(robot, spacing, 0.0, rotations)
    cells = sum(raster.cells.size for pair in pairs for raster in pair)
    needed = SLICE_BYTES * len(pairs) + RASTER_CELL_BYTES[robot.dim] * cells
    assert (
        0.9 * needed
        < estimate_raster_bytes(robot, spacing, 0.0, rotations, len(pairs))
        < 3.0 * needed
    )
