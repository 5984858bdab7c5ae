"""Range of returned yaws: [-pi, pi), as OMPL's bounds require."""

import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import cspace
from cspace import Robot, Workspace
from cspace.support.arrays import Floats
from tests.helpers.strategies import rotation_cells, seeds

MAP_SIZES = {
    "plane": ((16, 12), Robot.rectangle(0.3, 0.1)),
    "space": ((9, 8, 6), Robot.box((0.2, 0.1, 0.1))),
}


def assert_in_range(*angles: Any) -> None:
    for each in angles:
        values = np.asarray(each)
        assert (values >= -math.pi).all() and (values < math.pi).all(), values


def draw_endpoints(space: cspace.CSpace, rng: np.random.Generator) -> Floats:
    """Draw two FREE configurations, shifted by whole turns."""
    samples = space.sample_free(50, rng)
    good = samples[np.asarray(space.motion_is_free(samples, samples))]
    samples = samples if len(good) < 2 else good
    samples[:2, -1] += 2.0 * math.pi * rng.integers(-3, 4, 2)
    return samples[:2]


def returned_yaws(space: cspace.CSpace, rng: np.random.Generator) -> list[Any]:
    """Collect all yaws that a map in memory returns."""
    yaws: list[Any] = [space.sample_free(200, rng)[:, -1], space.sample_free(rng=rng)[-1]]
    yaws += [
        space.nearest_free([*q[:-1], rng.uniform(-20.0, 20.0)])[-1]
        for q in space.sample_free(20, rng)
    ]
    yaws += [space.rotations.centers[:, 0], space.rotations.centers, space.slice_rotations]
    yaws += [space.rotations.stored_arrays["yaw"], space.to_xarray().yaw.values]
    first, last = draw_endpoints(space, rng)
    for straight in (True, False):
        yaws.append(space.find_path(first, last, straight=straight)[:, -1])
        yaws.append(space.find_widest_path(first, last, straight=straight)[:, -1])
    return yaws


@settings(max_examples=12)
@given(rotations=rotation_cells(), kind=st.sampled_from(sorted(MAP_SIZES)), seed=seeds)
def test_maps_return_yaws_from_minus_pi_to_below_pi(rotations: Any, kind: str, seed: int) -> None:
    shape, robot = MAP_SIZES[kind]
    rng = np.random.default_rng(seed)
    occupied = rng.random(shape) < 0.02
    occupied[0, 0] = True
    workspace = Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, robot, rotations=rotations)
    assume(space.count()[0] > 0)
    with TemporaryDirectory() as folder:
        space.save(Path(folder) / "saved.zarr")
        tiled = cspace.build(
            workspace, robot, rotations=rotations, store=Path(folder) / "tiled.zarr", tile=8
        )
        opened = cspace.open(Path(folder) / "saved.zarr")
        assert isinstance(opened, cspace.CSpace)
        for each in (space, opened, tiled.window(space.grid.lower, space.grid.upper)):
            assert_in_range(*returned_yaws(each, rng))
        first, last = draw_endpoints(space, rng)
        assert_in_range(tiled.nearest_free(first)[-1], tiled.rotations.centers)
        assert_in_range(*(end[-1] for _, *both in tiled.subproblems(first, last) for end in both))
