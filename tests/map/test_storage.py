"""States packed in two bits against states in bytes."""

import copy

import numpy as np
import pytest
import trimesh

import cspace
from cspace import Robot, Workspace, builder, limits
from cspace.errors import InputError
from cspace.map import storage
from cspace.map.search import open_chain
from cspace.map.storage import PackedStates
from cspace.rotations import Rotations

RNG = np.random.default_rng(0)


def draw_workspace(shape):
    """Draw obstacles at different positions along each axis."""
    occupied = np.zeros(shape, dtype=bool)
    occupied[tuple(RNG.integers(0, shape, (7, len(shape))).T)] = True
    return Workspace.from_array(occupied, 0.1)


def make_wedge():
    """Build a robot without symmetries."""
    parts = [trimesh.creation.box((0.4, 0.1, 0.1)), trimesh.creation.box((0.1, 0.1, 0.3))]
    parts[1].apply_translation((0.15, 0.03, 0.2))
    return Robot.from_mesh(trimesh.util.concatenate(parts))


TRIANGLE = Robot.polygon([(0, 0), (0.4, 0), (0, 0.2)])  # without symmetries
PACKED_MAPS = {
    "SE(2)": lambda: (draw_workspace((21, 35)), TRIANGLE, 9),
    "SE(2), quarter turns": lambda: (draw_workspace((13, 70)), TRIANGLE, 12),
    "R^3 x yaw": lambda: (draw_workspace((11, 9, 13)), make_wedge(), 8),
    "SE(3)": lambda: (draw_workspace((11, 9, 13)), make_wedge(), Rotations.quaternions(2)),
}


def build_both(name, monkeypatch, **options):
    """Build a map with bytes, and with two bits."""
    workspace, robot, rotations = PACKED_MAPS[name]()
    unpacked = cspace.build(workspace, robot, rotations=rotations, **options)
    monkeypatch.setattr(limits, "MAX_UNPACKED_STATES", 0)
    packed = cspace.build(workspace, robot, rotations=rotations, **options)
    size = unpacked._kernel_map.states.size
    assert packed._facts["memory_bytes"] < size // 4 + 20 < unpacked._facts["memory_bytes"] == size
    return unpacked, packed


@pytest.mark.parametrize("size", [1, 3, 4, 7, 8, 33, 64, 999])
def test_packed_states_return_what_was_written(size):
    states = RNG.integers(0, 3, (9, size), dtype=np.uint8)
    packed = PackedStates(states.shape)
    for number in RNG.permutation(9):
        packed.write(int(number), states[number])
    again = packed.copy()
    packed.write(4, states[3])
    packed.write(4, states[4])
    for one in (packed, again):
        np.testing.assert_array_equal(np.array(list(one)), states)
        np.testing.assert_array_equal(one.counts(), [np.bincount(part, minlength=3) for part in states])
    np.testing.assert_array_equal(packed[2:5], states[2:5])
    with pytest.raises(IndexError):
        packed[9]


@pytest.mark.parametrize("name", PACKED_MAPS)
@pytest.mark.parametrize("method", ["direct", "fft"])
def test_build_packs_equal_states_and_reports_its_steps(name, method, monkeypatch):
    monkeypatch.setattr(builder, "SCRATCH_BYTES", 3000)
    done = []
    one, two = build_both(name, monkeypatch, method=method, progress=lambda *steps: done.append(steps))
    np.testing.assert_array_equal(two.cell_states, one.cell_states)
    np.testing.assert_array_equal(two._kernel_map.exterior, one._kernel_map.exterior)
    assert one.count() == two.count()
    slices = one._facts["slices"]
    steps = [step for step, total in done if total == slices]
    assert len(steps) > 1
    assert steps == sorted(steps)
    assert steps[-1] == slices


def test_packed_map_answers_like_the_unpacked_one(monkeypatch, tmp_path):
    one, two = build_both("SE(2)", monkeypatch, outside="free")
    q = RNG.uniform((-0.5, -0.5, -4.0), (2.6, 4.0, 4.0), (3000, 3))
    assert one.update(np.eye(4, 3) > 0, (3, 4)) == two.update(np.eye(4, 3) > 0, (3, 4))
    assert one.is_free(two.sample_free(300, np.random.default_rng(0))).all()
    inside = q[one.is_free(q) & one.grid.contains(q[:, :2])]
    np.testing.assert_array_equal(one.reachable_bounds(inside[0]), two.reachable_bounds(inside[0]))
    np.testing.assert_array_equal(one.nearest_free(q[0]), two.nearest_free(q[0]))
    cells = np.column_stack([one.rotations._cells_of(inside[:2]), one.grid.cell_of(inside[:2, :2])])
    chains = [open_chain(space._grid_kernel_map, space.rotations._neighbors, *cells) for space in (one, two)]
    np.testing.assert_array_equal(*chains)
    two.save(tmp_path / "map.zarr")
    assert cspace.open(tmp_path / "map.zarr").to_xarray().identical(one.to_xarray())
    other = copy.deepcopy(two)
    other.update(np.ones((9, 9), dtype=bool), (9, 9))
    np.testing.assert_array_equal(two.classify(q), one.classify(q))
    assert other.count() != two.count()


def test_packed_map_samples_its_free_cells_uniformly(monkeypatch):
    _, two = build_both("SE(2)", monkeypatch)
    samples = two.sample_free(20_000, np.random.default_rng(0))
    drawn = np.column_stack([two.rotations._cells_of(samples[:, 2:]), two.grid.cell_of(samples[:, :2])])
    numbers, times = np.unique(drawn, axis=0, return_counts=True)
    assert len(numbers) > 0.9 * two.count()[0]
    assert times.max() < 8.0 * times.mean()


def test_unpacking_refuses_too_little_memory(monkeypatch, tmp_path):
    _, two = build_both("SE(2)", monkeypatch)
    monkeypatch.setattr(storage, "free_bytes", lambda: 1000)
    for unpack in (lambda: two.cell_states, two.to_xarray, lambda: two.export(tmp_path / "map.npz")):
        with pytest.raises(InputError, match=r"6\.6\d kB.*950 bytes.*states_at"):
            unpack()
    assert two.states_at(0.3).shape == two.grid.shape


def test_maps_with_overlap_counts_store_bytes(monkeypatch):
    monkeypatch.setattr(limits, "MAX_UNPACKED_STATES", 0)
    workspace, robot, rotations = PACKED_MAPS["SE(2)"]()
    space = cspace.build(workspace, robot, rotations=rotations, counts=True)
    assert space._facts["memory_bytes"] == 5 * space._kernel_map.states.size
