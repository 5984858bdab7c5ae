"""ROS messages without ROS, and costs of Nav2."""

import math
from array import array
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial import cKDTree

import cspace
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from cspace.files.ros import Costmap, OccupancyGrid
from tests.helpers.handmade import fill_boxes
from tests.helpers.refusals import refusals

RNG = np.random.default_rng(0)


def make_message(values, resolution=0.05, origin=(0.0, 0.0), yaw=0.0, data=None):
    """Make a ROS message; values start at the lowest y."""
    height, width = np.shape(values)
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    place = SimpleNamespace(
        position=SimpleNamespace(x=origin[0], y=origin[1], z=0.0), orientation=turn
    )
    info = SimpleNamespace(resolution=resolution, width=width, height=height, origin=place)
    flat = np.ravel(values).astype(np.int8)
    return SimpleNamespace(
        header=SimpleNamespace(frame_id="odom"), info=info, data=(data or (lambda x: x))(flat)
    )


class Strict:
    """Message like rclpy's, with declared fields and types only."""

    def __init__(self, **fields):
        object.__setattr__(self, "fields", fields)

    def __getattr__(self, name):
        try:
            return object.__getattribute__(self, "fields")[name]
        except KeyError:
            raise AttributeError(name) from None

    def __setattr__(self, name, value):
        assert type(value) is type(self.fields[name]), name
        if isinstance(value, array):
            assert value.typecode == self.fields[name].typecode
        self.fields[name] = value


def make_strict(about, sizes, typecode):
    place = Strict(
        position=Strict(x=0.0, y=0.0, z=0.0), orientation=Strict(x=0.0, y=0.0, z=0.0, w=1.0)
    )
    info = Strict(resolution=0.0, origin=place, **dict.fromkeys(sizes, 0))
    return Strict(header=Strict(stamp=None, frame_id=""), data=array(typecode), **{about: info})


@pytest.fixture(scope="module")
def spaces():
    workspace = Workspace.from_array(
        fill_boxes((40, 30), np.s_[20, :18], np.s_[5:8, 22:26]), 0.1, (-1.0, 2.0)
    )
    disc, car = Robot.disc(0.23), Robot.rectangle(0.5, 0.3)
    return {"disc": cspace.build(workspace, disc), "car": cspace.build(workspace, car, rotations=6)}


@pytest.mark.parametrize("data", [None, tuple, list, lambda x: array("b", x.tolist())])
def test_values_become_cells(data):
    values = np.array([[0, 24, 25, 64], [65, 100, -1, 10], [0, 0, 0, 99]])
    workspace = Workspace.from_occupancy_grid(make_message(values, 0.25, (1.0, -2.0), data=data))
    assert (workspace.grid.lower, workspace.grid.spacing, workspace.grid.shape) == (
        (1.0, -2.0),
        0.25,
        (4, 3),
    )
    assert (workspace.outer == ((values >= 25) | (values < 0)).T).all()
    assert (workspace.unknown == ((values < 0) | ((values >= 25) & (values < 65))).T).all()
    free = Workspace.from_occupancy_grid(make_message(values, data=data), "free")
    assert (free.outer == (values >= 65).T).all()
    published = Workspace.from_occupancy_grid(
        make_message(values, data=data), "free", free_thresh=0.995, occupied_thresh=1
    )
    assert (published.outer == (values == 100).T).all()


@pytest.mark.parametrize("yaw", [0.0, 0.3, math.pi / 2, -2.0])
@pytest.mark.parametrize("unknown", ["occupied", "free"])
def test_a_message_agrees_with_the_map_file(tmp_path, yaw, unknown):
    values = RNG.choice([0, 100, -1], (7, 9), p=[0.6, 0.2, 0.2])
    pixels = np.select([values == 0, values == 100], [254, 0], 205).astype(np.uint8)[::-1]
    Image.fromarray(pixels).save(tmp_path / "map.pgm")
    (tmp_path / "map.yaml").write_text(
        f"image: map.pgm\nresolution: 0.05\norigin: [-1.5, 2.5, {yaw!r}]\nnegate: 0\noccupied_thresh: 0.65\n"
        "free_thresh: 0.19\n"
    )
    saved = Workspace.from_ros_map(tmp_path / "map.yaml", unknown)
    single = float(np.float32(0.05))  # the type on the wire
    workspace = Workspace.from_occupancy_grid(
        make_message(values, single, (-1.5, 2.5), yaw), unknown
    )
    assert np.allclose(workspace.grid.lower, saved.grid.lower, atol=1e-12)
    assert (workspace.grid.spacing, workspace.grid.shape) == (0.05, saved.grid.shape)
    assert (workspace.outer == saved.outer).all()
    assert (workspace.inner == saved.inner).all()


@pytest.mark.parametrize("unknown", ["occupied", "free"])
@pytest.mark.parametrize("fill", [None, make_strict("info", ("width", "height"), "b")])
def test_a_map_survives_its_message(spaces, unknown, fill):
    space = spaces["disc"]
    assert sorted(np.unique(space.cell_states).tolist()) == [FREE, MIXED, BLOCKED]
    msg = space.to_occupancy_grid(fill, frame_id="odom")
    assert msg.header.frame_id == "odom"
    assert isinstance(msg, OccupancyGrid) if fill is None else msg is fill
    workspace = Workspace.from_occupancy_grid(msg, unknown)
    assert workspace.grid == space.grid
    assert (
        workspace.outer
        == (space.cell_states != FREE if unknown == "occupied" else space.cell_states == BLOCKED)
    ).all()


def test_a_turning_robot_is_free_only_at_all_rotations(spaces):
    space = spaces["car"]
    cells = np.array(space.to_occupancy_grid().data).reshape(30, 40).T
    assert ((cells == 0) == (space.cell_states == FREE).all(axis=0)).all()
    assert ((cells == 100) == (space.cell_states == BLOCKED).all(axis=0)).all()
    one = np.array(space.to_occupancy_grid(rotation=1.0).data).reshape(30, 40).T
    assert ((one == 0) == (space.states_at(1.0) == FREE)).all()
    assert (one == 0).sum() > (cells == 0).sum() > 0


def measure_distances(space, free):
    """Return distances to points not free, by brute force."""
    ringed = np.argwhere(np.pad(~free, 1, constant_values=True)) - 1
    steps = np.indices((3, 3)).reshape(2, -1).T  # the candidates in a cell, in half cells
    tree = cKDTree((2 * ringed[:, None] + steps).reshape(-1, 2))
    centers = 2 * np.indices(free.shape).reshape(2, -1).T + 1
    return space.grid.spacing / 2 * tree.query(centers)[0].reshape(free.shape)


@pytest.mark.parametrize("fill", [None, make_strict("metadata", ("size_x", "size_y"), "B")])
@pytest.mark.parametrize(("radius", "scaling"), [(0.55, 10.0), (0.8, 3.0), (0.0, 1.0), (1e9, 0.0)])
def test_costs_agree_with_the_formula(spaces, radius, scaling, fill):
    space = spaces["disc"]
    msg = space.to_costmap(fill, inflation_radius=radius, cost_scaling_factor=scaling)
    assert isinstance(msg, Costmap) if fill is None else msg is fill
    assert (msg.metadata.size_x, msg.metadata.size_y, msg.metadata.origin.position.x) == (
        40,
        30,
        -1.0,
    )
    costs, apart = (
        np.array(msg.data).reshape(30, 40).T,
        measure_distances(space, space.cell_states == FREE),
    )
    for cell in np.ndindex(40, 30):
        expected = {math.floor(252 * math.exp(-scaling * (apart[cell] + e))) for e in (-1e-9, 1e-9)}
        if space.workspace.outer[cell]:
            expected = {254}
        elif space.cell_states[cell] != FREE:
            expected = {253}
        elif apart[cell] + 0.23 > radius + 1e-3:
            expected = {0}
        elif apart[cell] + 0.23 > radius - 1e-3:
            expected |= {0}
        assert costs[cell] in expected, cell


def test_no_cell_is_cheaper_than_in_nav2(spaces):
    """Compare with Nav2, which uses cell centers and circles."""
    space, radius, scaling = spaces["disc"], 0.7, 4.0
    costs = (
        np.array(space.to_costmap(inflation_radius=radius, cost_scaling_factor=scaling).data)
        .reshape(30, 40)
        .T
    )
    obstacles = cKDTree(space.grid.center_of(np.argwhere(space.workspace.outer)))
    apart = obstacles.query(space.grid.center_of(np.indices((40, 30)).reshape(2, -1).T))[0].reshape(
        40, 30
    )
    theirs = np.floor(252 * np.exp(-scaling * (apart - 0.23)))
    theirs[apart > radius], theirs[apart <= 0.23], theirs[apart == 0] = 0, 253, 254
    assert (costs >= theirs).all()
    assert (costs < 253).sum() > 300


def test_costs_use_the_best_rotation_by_default(spaces):
    space = spaces["car"]
    best = np.array(space.to_costmap().data)
    each = [np.array(space.to_costmap(rotation=yaw).data) for yaw in space.rotations.centers[:, 0]]
    assert (best == np.min(each, axis=0)).all()
    assert (each[0] != each[1]).any()


def compute_costs(space, radius, scaling, rotation=None):
    """Compute costs from clearances at cell centers."""
    turns = space.rotations.centers if rotation is None else np.array([[rotation]])
    middles = space.grid.center_of(np.indices(space.grid.shape).reshape(2, -1).T)
    each = [
        space.clearance(np.hstack([middles, np.tile(turn, (len(middles), 1))])) for turn in turns
    ]
    clearance, inscribed = (
        np.max(each, axis=0).reshape(space.grid.shape),
        space.robot.inscribed_radius + space.margin,
    )
    costs = np.floor(252 * np.exp(-scaling * clearance))
    costs[clearance + inscribed > radius] = 0
    costs[clearance == 0] = 253
    costs[(clearance == 0) & space.workspace.outer] = 254
    return costs


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    rotations=st.sampled_from([None, 5, 8]),
    outside=st.sampled_from(["blocked", "free"]),
    changes=st.lists(
        st.tuples(st.booleans(), st.sampled_from([0.2, 0.55, 1.0, 30.0])), min_size=1, max_size=4
    ),
)
def test_costs_follow_updates(seed, rotations, outside, changes):
    rng = np.random.default_rng(seed)
    occupied = rng.random((24, 30)) < rng.choice([0.0, 0.005, 0.05])
    workspace, robot = (
        Workspace.from_array(occupied, 0.1, (3.0, -2.0)),
        Robot.rectangle(0.5, 0.2, (0.1, 0.0)),
    )
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    for comes, radius in changes:
        options = {"inflation_radius": radius, "cost_scaling_factor": 2.0}
        costs = np.array(space.to_costmap(**options).data).reshape(30, 24).T
        np.testing.assert_array_equal(costs, compute_costs(space, radius, 2.0))
        if rotations:
            one = np.array(space.to_costmap(rotation=1.0, **options).data).reshape(30, 24).T
            np.testing.assert_array_equal(one, compute_costs(space, radius, 2.0, 1.0))
        x, y = rng.uniform((2.5, -2.5), (6.0, 1.5))
        if comes or "cart" not in space.obstacles:
            space.add_obstacle("cart", shapely.box(x, y, x + 0.5, y + 0.3))
        else:
            space.remove_obstacle("cart")


def test_unknown_cells_stay_unknown_in_a_costmap():
    values = np.zeros((20, 20), dtype=int)
    values[:5], values[10, 10] = -1, 100
    for unknown, seen in (("occupied", 255), ("free", 0)):
        workspace = Workspace.from_occupancy_grid(make_message(values), unknown)
        costs = np.array(
            cspace.build(workspace, Robot.disc(0.06), outside="free").to_costmap().data
        ).reshape(20, 20)
        assert costs[10, 10] == 254
        assert set(costs[:4].ravel().tolist()) <= ({255} if seen == 255 else set(range(253)))


def changed(**fields):
    message = make_message(np.zeros((2, 3)))
    for path, value in fields.items():
        *way, last = path.split("__")
        target = message
        for name in way:
            target = getattr(target, name)
        setattr(target, last, value)
    return message


def test_an_unset_quaternion_is_no_rotation():
    message = changed(info__origin__orientation__w=0.0)
    assert Workspace.from_occupancy_grid(message).grid.shape == (3, 2)


@refusals(
    "msg, options, message",
    (None, {}, r"msg has no info.*nav_msgs/OccupancyGrid"),
    (np.zeros((3, 3)), {}, r"msg has no info"),
    (SimpleNamespace(info=SimpleNamespace(width=2), data=[]), {}, r"msg has no info\.height"),
    (changed(info__width=0), {}, r"msg\.info\.width is 0; it must be a whole number above zero"),
    (changed(info__height=2.5), {}, r"msg\.info\.height is 2\.5"),
    (changed(info__width=4), {}, r"msg\.data has shape \(6,\) .* width x height = 4 x 2"),
    (changed(data=[0.5] * 6), {}, r"msg\.data has shape .* type float64"),
    (changed(data=bytes(6)), {}, r"msg\.data is b.*numeric"),
    (changed(data=[[1], [1, 2]]), {}, r"msg\.data is \[\[1\], \[1, 2\]\]; it must be numeric"),
    (changed(info__resolution=0.0), {}, r"msg\.info\.resolution is 0\.0"),
    (changed(info__resolution=math.nan), {}, r"msg\.info\.resolution is nan"),
    (changed(info__origin__position__x=math.inf), {}, r"msg\.info\.origin\.position\.x is inf"),
    (
        changed(info__origin__orientation__x=1.0),
        {},
        r"orientation is \(1, 0, 0, 1\), which is tilted",
    ),
    (changed(), {"unknown": "maybe"}, "unknown is 'maybe'"),
    (changed(), {"free_thresh": 0.7}, "free_thresh is 0.7 and occupied_thresh is 0.65"),
    (changed(), {"occupied_thresh": -1}, "occupied_thresh is -1"),
)
def test_from_occupancy_grid_refuses_in_one_line(msg, options, message):
    with pytest.raises(InputError, match=message) as caught:
        Workspace.from_occupancy_grid(msg, **options)
    assert "\n" not in str(caught.value)


SOLID = Workspace.from_array(np.zeros((3, 3, 3), bool), 0.1)


@refusals(
    "call, message",
    (lambda car: car.to_costmap(inflation_radius=-1), "inflation_radius is -1"),
    (lambda car: car.to_costmap(cost_scaling_factor=math.nan), "cost_scaling_factor is nan"),
    (lambda car: car.to_costmap(rotation=(1, 2)), "rotation"),
    (
        lambda car: car.to_costmap(SimpleNamespace(header=SimpleNamespace(frame_id=""))),
        "msg has no metadata.resolution; .*nav2_msgs",
    ),
    (lambda car: car.to_occupancy_grid(object()), r"msg has no header\.frame_id"),
    (
        lambda car: cspace.build(SOLID, Robot.ball(0.05)).to_occupancy_grid(),
        "the map is one in space",
    ),
    (lambda car: cspace.build(SOLID, Robot.ball(0.05)).to_costmap(), "the map is one in space"),
)
def test_messages_refuse_unsuitable_maps_and_arguments(spaces, call, message):
    with pytest.raises(InputError, match=message):
        call(spaces["car"])
