"""Maps and plans as messages of ROS without ROS, and costs of Nav2."""

import pickle
from array import array

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from tests.helpers.handmade import build_empty
from tests.helpers.messages import as_mapping, build_spaces, make_grid, make_message
from tests.helpers.refusals import check_refused, refusals
from tests.helpers.strategies import examples, seeds


@pytest.fixture(scope="module")
def spaces():
    return build_spaces()


class Strict:
    """Message like rclpy's, with declared fields and types only."""

    def __init__(self, **fields):
        object.__setattr__(self, "fields", fields)

    def __getattr__(self, name):
        if name not in self.fields:
            raise AttributeError(name)
        return self.fields[name]

    def __setattr__(self, name, value):
        assert type(value) is type(self.fields[name]), name
        assert not isinstance(value, array) or value.typecode == self.fields[name].typecode
        self.fields[name] = value


def make_strict(info_name, sizes, typecode):
    """Make an empty message like rclpy's."""
    turn = Strict(x=0.0, y=0.0, z=0.0, w=1.0)
    place = Strict(position=Strict(x=0.0, y=0.0, z=0.0), orientation=turn)
    info = Strict(resolution=0.0, origin=place, **dict.fromkeys(sizes, 0))
    header = Strict(stamp=None, frame_id="")
    return Strict(header=header, data=array(typecode), **{info_name: info})


def get_cells(msg, shape=(40, 30)):
    """Return the data of a message, shape (nx, ny)."""
    return np.reshape(msg.data, shape[::-1]).T


def test_a_map_survives_its_message(spaces):
    space = spaces["disc"]
    assert np.unique(space.cell_states).tolist() == [FREE, MIXED, BLOCKED]
    msg = make_strict("info", ("width", "height"), "b")
    assert space.to_occupancy_grid(msg, frame_id="odom") is msg
    assert msg.header.frame_id == "odom"
    origin = msg.info.origin
    assert origin.position.fields == dict(zip("xyz", (*space.grid.lower, 0.0), strict=True))
    assert origin.orientation.fields == {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    cautious = Workspace.from_occupancy_grid(msg)
    assert cautious.grid == space.grid
    assert (cautious.outer == (space.cell_states != FREE)).all()
    bold = Workspace.from_occupancy_grid(msg, "free")
    assert (bold.outer == (space.cell_states == BLOCKED)).all()


def test_a_turning_robot_is_free_only_at_all_rotations(spaces):
    space = spaces["car"]
    cells = get_cells(space.to_occupancy_grid())
    assert ((cells == 0) == (space.cell_states == FREE).all(axis=0)).all()
    assert ((cells == 100) == (space.cell_states == BLOCKED).all(axis=0)).all()
    one = get_cells(space.to_occupancy_grid(rotation=1.0))
    assert ((one == 0) == (space.states_at(1.0) == FREE)).all()
    assert (one == 0).sum() > (cells == 0).sum() > 0


def test_no_cell_is_cheaper_than_in_nav2(spaces):
    """Compare with Nav2, which uses cell centers and circles."""
    space = spaces["disc"]
    msg = make_strict("metadata", ("size_x", "size_y"), "B")
    assert space.to_costmap(msg, inflation_radius=0.7, cost_scaling_factor=4.0) is msg
    assert (msg.metadata.size_x, msg.metadata.origin.position.x) == (40, -1.0)
    costs = get_cells(msg)
    obstacles = cKDTree(space.grid.center_of(np.argwhere(space.workspace.outer)))
    centers = space.grid.center_of(np.indices((40, 30)).reshape(2, -1).T)
    distance = obstacles.query(centers)[0].reshape(40, 30)
    theirs = np.floor(252 * np.exp(-4.0 * (distance - 0.23)))
    theirs[distance > 0.7] = 0
    theirs[distance <= 0.23] = 253
    theirs[distance == 0] = 254
    assert (costs >= theirs).all()
    assert (costs < 253).sum() > 300


def compute_costs(space, radius, scaling, turns):
    """Compute costs from the best of the clearances at cell centers."""
    middles = space.grid.center_of(np.indices(space.grid.shape).reshape(2, -1).T)
    columns = [np.hstack([middles, np.tile(turn, (len(middles), 1))]) for turn in turns]
    clearance = np.max([space.clearance(q) for q in columns], axis=0).reshape(space.grid.shape)
    costs = np.floor(252 * np.exp(-scaling * clearance))
    costs[clearance + space.robot.shape.inner.inscribed_radius + space.margin > radius] = 0
    costs[clearance == 0] = 253
    costs[(clearance == 0) & space.workspace.outer] = 254
    return costs


@examples(40)
@given(st.sampled_from([None, 5, 8]), st.sampled_from([0.2, 0.55, 1.0, 30.0]), seeds)
def test_costs_are_those_of_the_best_rotation(rotations, radius, seed):
    rng = np.random.default_rng(seed)
    occupied = rng.random((24, 30)) < rng.choice([0.0, 0.005, 0.05])
    workspace = Workspace.from_array(occupied, 0.1, (3.0, -2.0))
    outside = rng.choice(["blocked", "free"])
    robot = Robot.rectangle(0.5, 0.2, (0.1, 0.0))
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    options = {"inflation_radius": radius, "cost_scaling_factor": 2.0}
    choices = {None: space.rotations.centers} | ({1.0: [[1.0]]} if rotations else {})
    for rotation, turns in choices.items():
        costs = get_cells(space.to_costmap(rotation=rotation, **options), (24, 30))
        np.testing.assert_array_equal(costs, compute_costs(space, radius, 2.0, turns))


def test_unknown_cells_stay_unknown_in_a_costmap():
    values = np.zeros((20, 20), dtype=int)
    values[:5] = -1
    values[10, 10] = 100
    for unknown, seen in (("occupied", {255}), ("free", set(range(253)))):
        workspace = Workspace.from_occupancy_grid(make_message(values), unknown)
        space = cspace.build(workspace, Robot.disc(0.06), outside="free")
        costs = get_cells(space.to_costmap(), (20, 20))
        assert costs[10, 10] == 254
        assert set(costs[:, :4].ravel().tolist()) <= seen


def test_mappings_are_filled_like_messages(odom):
    space, plan = odom
    timed = plan.trajectory(max_velocity=1.0, max_acceleration=1.0)
    for fill in (plan.to_path, timed.to_path, space.to_occupancy_grid, space.to_costmap):
        message, mapping = as_mapping(fill()), fill({})
        # A mapping gets what is known; the defaults of a message are left out.
        assert_within(mapping, message)
    stamped = timed.to_path({"header": {"stamp": {"secs": 5, "nsecs": 0}}})
    assert stamped["poses"][-1]["header"]["stamp"]["secs"] == 5 + int(timed.duration)


def assert_within(part, whole):
    """Check that a mapping has only fields and values of another one."""
    if isinstance(part, dict):
        assert part.keys() <= whole.keys()
        for name, value in part.items():
            assert_within(value, whole[name])
    elif isinstance(part, list):
        for one, other in zip(part, whole, strict=True):
            assert_within(one, other)
    else:
        assert part == pytest.approx(whole)


@pytest.fixture(scope="module")
def odom():
    """Return a map of a grid in the frame odom, and a plan on it."""
    space = cspace.build(Workspace.from_occupancy_grid(make_grid()), Robot.disc(0.15))
    return space, planners.plan(space, (0.5, 0.5), (2.5, 1.5), time_limit=2, seed=1)


def test_the_frame_of_a_grid_is_that_of_what_is_made_from_it(tmp_path, odom):
    space, plan = odom
    messages = {
        "path": plan.to_path(),
        "pickled path": pickle.loads(pickle.dumps(plan)).to_path(),
        "timed path": plan.trajectory(max_velocity=1.0, max_acceleration=1.0).to_path(),
        "grid": space.to_occupancy_grid(),
        "costmap": space.to_costmap(),
    }
    space.save(tmp_path / "map.zarr")
    messages["saved"] = cspace.open(tmp_path / "map.zarr").to_occupancy_grid()
    workspace = Workspace.from_occupancy_grid(make_grid())
    tiled = cspace.build(workspace, Robot.disc(0.15), store=tmp_path / "tiles.zarr", tile=16)
    messages["tiled"] = tiled.window((0.0, 0.0), (2.0, 1.0)).to_occupancy_grid()
    messages["overview"] = tiled.overview(10).to_costmap()
    assert {name: message.header.frame_id for name, message in messages.items()} == dict.fromkeys(
        messages, "odom"
    )
    assert {pose.header.frame_id for pose in messages["path"].poses} == {"odom"}
    assert cspace.open(tmp_path / "tiles.zarr").frame_id == tiled.frame_id == "odom"
    turned = make_grid()
    turned.info.origin.orientation.z, turned.info.origin.orientation.w = 0.6, 0.8
    assert Workspace.from_occupancy_grid(turned).grid.frame_id == "odom"
    # Who names a frame gets it, and a map without one is in "map".
    assert plan.to_path(frame_id="base").header.frame_id == "base"
    assert space.to_costmap(frame_id="base").header.frame_id == "base"
    assert build_empty((9, 9), Robot.disc(0.1)).to_costmap().header.frame_id == "map"


def test_a_map_file_warns_that_it_names_no_frame(tmp_path, odom):
    space, _ = odom
    with pytest.warns(UserWarning, match="serves it in 'map', not in") as heard:
        space.export(tmp_path / "map.yaml")
    assert str(heard[0].message).endswith("'odom'")
    assert Workspace.open(tmp_path / "map.yaml").grid == space.grid
    same = cspace.build(Workspace.from_occupancy_grid(make_grid("map")), Robot.disc(0.15))
    same.export(tmp_path / "same.yaml")


@refusals(
    "robot, options, hint",
    ("disc:0.1", {"cost_scaling_factor": -3.0}, "cost_scaling_factor is -3.0 ... zero"),
    ("ball:0.1", {}, "the map is one in space ... costmap"),
    ("disc:0.1", {"msg": make_grid()}, "nav2_msgs"),
)
def test_costs_of_other_kinds_are_refused(robot, options, hint):
    space = build_empty((9, 9, 9) if robot == "ball:0.1" else (9, 9), robot)
    check_refused(lambda: space.to_costmap(**options), hint)
