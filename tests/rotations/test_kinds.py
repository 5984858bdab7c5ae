"""A new kind of rotation cells."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import cspace
from cspace._rotations import Rotations
from cspace._rotations.base import COVERING_ANGLE, ROTATION_UNITS, Coordinate
from cspace._rotations.yaw import YawRotations

COUNT = 8


@dataclass(frozen=True)
class PitchRotations(YawRotations):
    """Rotation cells of pitch, in space."""

    names = ("pitch",)
    _limits = "a pitch small enough"
    _about_z = False
    _COORDINATES: ClassVar[Mapping[str, Coordinate]] = {
        "pitch": Coordinate("middle of a cell", "rad", bounds="pitch_bounds"),
        "pitch_bounds": Coordinate("borders of a cell", "rad", {"bound": 2}),
        "covering_angle": COVERING_ANGLE,
    }

    @classmethod
    def _of_stored_arrays(cls, coordinates):
        return super()._of_stored_arrays({"yaw_bounds": coordinates["pitch_bounds"]})

    def _preserves(self, shape):
        return shape.is_round

    def _assign_slices(self, shape):
        return np.zeros(len(self), np.int64) if shape.is_round else np.arange(len(self))

    def _find_images(self, shape):
        return Rotations._find_images(self, shape)

    def make_matrices(self, rotation, dim):
        made = Rotation.from_rotvec(rotation.reshape(-1, 1) * [0.0, 1.0, 0.0]).as_matrix()
        return made.reshape(*rotation.shape[:-1], 3, 3)


@pytest.fixture(scope="module")
def space():
    """Build a map of a bar and a gap."""
    occupied = np.zeros((16, 8, 16), dtype=bool)
    occupied[7:9, :, :] = True
    occupied[7:9, :, 2:14] = False
    occupied[4:7, :, 9] = True
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(Rotations._KINDS, "pitch", lambda: PitchRotations)
        patch.setitem(ROTATION_UNITS, "pitch", "rad")
        workspace = cspace.Workspace.from_array(occupied, 0.1)
        robot = cspace.Robot.box((0.5, 0.12, 0.06))
        yield cspace.build(workspace, robot, rotations=PitchRotations._of_value(COUNT))


def test_samples_and_files_keep_rotations(space, tmp_path):
    q = space.sample_free(50, np.random.default_rng(6))
    assert q.shape == (50, 4) and space.is_free(q).all()
    space.save(tmp_path / "map.zarr")
    again = cspace.open(tmp_path / "map.zarr")
    assert again.rotations == space.rotations and isinstance(again.rotations, PitchRotations)
    assert np.array_equal(again.classify(q), space.classify(q))
