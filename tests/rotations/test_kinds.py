"""A new kind of rotation cells."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import BLOCKED, FREE, CSpace
from cspace.cli.options import parse_configuration, parse_rotation_cells
from cspace.errors import InputError
from cspace.rotations import Rotations
from cspace.rotations.base import COVERING_ANGLE, Coordinate, Symmetric
from cspace.rotations.yaw import YawRotations
from cspace.support.arrays import Bools, Floats, Ints
from tests.helpers.maps import proven_paths

COUNT = 8


@dataclass(frozen=True)
class PitchRotations(YawRotations):
    """Rotation cells of pitch, in space."""

    names = ("pitch",)
    limits = "a pitch small enough"
    about_z = False
    COORDINATES: ClassVar[Mapping[str, Coordinate]] = {
        "pitch": Coordinate("middle of a cell", "rad", bounds="pitch_bounds"),
        "pitch_bounds": Coordinate("borders of a cell", "rad", {"bound": 2}),
        "covering_angle": COVERING_ANGLE,
    }

    @classmethod
    def of_stored_arrays(cls, coordinates: Mapping[str, Any]) -> "PitchRotations":
        return super().of_stored_arrays({"yaw_bounds": coordinates["pitch_bounds"]})

    def find_yaw(self, q: Floats) -> None:
        return None

    def from_matrix(self, matrix: Floats) -> Floats:
        return np.arctan2(matrix[0, 2:], matrix[0, :1])

    def preserve(self, shape: Symmetric) -> bool:
        return shape.is_round

    def assign_slices(self, shape: Symmetric) -> Ints:
        return np.zeros(len(self), np.int64) if shape.is_round else np.arange(len(self))

    def find_images(self, shape: Symmetric) -> list[tuple[Floats, Ints]]:
        return Rotations.find_images(self, shape)

    def make_matrices(self, rotation: Floats, dim: int) -> Floats:
        made = Rotation.from_rotvec(rotation.reshape(-1, 1) * [0.0, 1.0, 0.0]).as_matrix()
        return made.reshape(*rotation.shape[:-1], 3, 3)


@pytest.fixture(scope="module")
def space() -> Iterator[CSpace]:
    """Build a map of a bar and a gap."""
    occupied = np.zeros((16, 8, 16), dtype=bool)
    occupied[7:9, :, :] = True
    occupied[7:9, :, 2:14] = False
    occupied[4:7, :, 9] = True
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(Rotations.KINDS, "pitch", PitchRotations)
        workspace = cspace.Workspace.from_array(occupied, 0.1)
        robot = cspace.Robot.box((0.5, 0.12, 0.06))
        yield cspace.build(workspace, robot, rotations=PitchRotations.of_value(COUNT))


def draw(space: CSpace, n: int) -> Floats:
    rng = np.random.default_rng(3)
    low, high = [*space.grid.lower, -4.0], [*space.grid.upper, 4.0]
    return rng.uniform(low, high, (n, 4))


def collides(space: CSpace, q: Floats) -> Bools:
    """Return True for configurations with a colliding sample point."""
    axes = [np.linspace(-size / 2, size / 2, n) for size, n in ((0.5, 31), (0.12, 9), (0.06, 7))]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    occupied, answers = (
        np.pad(space.workspace.outer, 1, constant_values=True),
        np.empty(len(q), dtype=np.bool_),
    )
    for k, turn in enumerate(Rotation.from_euler("y", q[:, 3:]).as_matrix()):
        cells = np.floor((turn @ points.T + q[k, :3, None]) / 0.1).astype(int) + 1
        answers[k] = occupied[
            tuple(np.clip(cells, 0, np.reshape(occupied.shape, (3, 1)) - 1))
        ].any()
    return answers


def test_states_agree_with_samples_of_the_robot(space: CSpace) -> None:
    assert space.axes == ("x", "y", "z", "pitch")
    q = draw(space, 3000)
    states = space.classify(q)
    truth = collides(space, q)
    assert not truth[states == FREE].any()
    assert truth[states == BLOCKED].all()
    assert (states == FREE).sum() > 100 and (states == BLOCKED).sum() > 100
    check = space.point_checker()
    assert [check(*each) for each in q[:200]] == (states[:200] == FREE).tolist()


def test_messages_name_the_rotation(space: CSpace) -> None:
    with pytest.raises(
        InputError, match=r"space has the axes x y z pitch; planners take .*space.find_path"
    ):
        planners.plan(space, *space.sample_free(2, np.random.default_rng(1)))
    with pytest.raises(InputError, match="a pitch small enough"):
        space.classify([0.5, 0.5, 0.5, np.inf])
    with pytest.raises(InputError, match="has the pitch 'up'"):
        parse_configuration("1,1,1,up", "start", space.axes, space.units)
    with pytest.raises(InputError, match="pitch:8"):
        parse_rotation_cells("roll:7")


def test_free_motions_are_free_at_all_their_points(space: CSpace) -> None:
    q0 = draw(space, 4000)
    q0 = q0[space.is_free(q0)]
    q1 = q0 + np.random.default_rng(4).uniform(-0.3, 0.3, q0.shape) * [1, 1, 1, 6]
    free = space.motion_is_free(q0, q1)
    assert 20 < free.sum() < len(free)
    first, steps = q0[free][:60], (q1 - q0)[free][:60]
    steps[:, 3] = (steps[:, 3] + math.pi) % (2 * math.pi) - math.pi
    assert not any(collides(space, first + t * steps).any() for t in np.linspace(0.0, 1.0, 9))
    check = space.edge_checker()
    assert [check(*a, *b) for a, b in zip(q0, q1, strict=True)] == free.tolist()


def test_clearance_is_a_lower_bound(space: CSpace) -> None:
    q = draw(space, 400)
    clearances = space.clearance(q)
    assert ((clearances > 0) <= (space.classify(q) == FREE)).all()
    steps = np.random.default_rng(5).normal(size=(30, *q.shape)) * [1.0, 1.0, 1.0, 0.0]
    steps *= 0.999 * clearances[:, None] / np.linalg.norm(steps, axis=-1, keepdims=True)
    assert space.is_free((q + steps)[:, clearances > 0]).all()


def test_paths_exist_between_connected_cells(space: CSpace) -> None:
    states = np.array([space.states_at(pitch) for pitch in space.rotations.centers[:, 0]])
    labels = []
    for passable in (states == FREE, states != BLOCKED):
        numbers = np.arange(states.size).reshape(states.shape)
        pairs = [(numbers, np.roll(numbers, -1, axis=0), passable & np.roll(passable, -1, axis=0))]
        for axis in (1, 2, 3):
            first, last = np.split(numbers, [-1], axis)[0], np.split(numbers, [1], axis)[1]
            pairs.append((first, last, passable.ravel()[first] & passable.ravel()[last]))
        rows, columns = (np.concatenate([pair[k][pair[2]] for pair in pairs]) for k in (0, 1))
        graph = coo_array((np.ones(len(rows)), (rows, columns)), shape=(states.size, states.size))
        labels.append(connected_components(graph, directed=False)[1])
    answers = set()
    q = draw(space, 300)
    q = q[space.is_free(q)]
    cells = np.floor(q[:, :3] / 0.1).astype(int)
    at = np.ravel_multi_index((space.rotations.find_cells(q), *cells.T), states.shape)
    for k in range(1, len(q)):
        answers.add(answer := proven_paths(space, q[0], q[k]))
        assert answer is not False or labels[1][at[0]] != labels[1][at[k]]
        assert answer is True if labels[0][at[0]] == labels[0][at[k]] else answer is not True
    assert True in answers


def test_samples_and_files_keep_rotations(space: CSpace, tmp_path: Path) -> None:
    q = space.sample_free(50, np.random.default_rng(6))
    assert q.shape == (50, 4) and space.is_free(q).all()
    space.save(tmp_path / "map.zarr")
    again = cspace.open(tmp_path / "map.zarr")
    assert again.rotations == space.rotations and isinstance(again.rotations, PitchRotations)
    assert np.array_equal(again.classify(q), space.classify(q))
