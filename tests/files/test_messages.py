"""ROS messages without ROS, and costs of Nav2."""

import json
import math
import pickle
import types
from array import array
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace import BLOCKED, FREE, MIXED, InputError, Robot, Workspace
from tests.helpers.handmade import build_empty, fill_boxes
from tests.helpers.refusals import refusals
from tests.helpers.strategies import examples, seeds


def make_message(values, resolution=0.05, origin=(0.0, 0.0), yaw=0.0):
    """Make a ROS message; values start at the lowest y."""
    height, width = np.shape(values)
    turn = SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    corner = SimpleNamespace(x=origin[0], y=origin[1], z=0.0)
    place = SimpleNamespace(position=corner, orientation=turn)
    info = SimpleNamespace(resolution=resolution, width=width, height=height, origin=place)
    return SimpleNamespace(info=info, data=array("b", np.ravel(values).tolist()))


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


@pytest.fixture(scope="module")
def spaces():
    cells = fill_boxes((40, 30), np.s_[20, :18], np.s_[5:8, 22:26])
    workspace = Workspace.from_array(cells, 0.1, (-1.0, 2.0))
    car = Robot.rectangle(0.5, 0.3)
    return {
        "disc": cspace.build(workspace, Robot.disc(0.23)),
        "car": cspace.build(workspace, car, rotations=6),
    }


def get_cells(msg, shape=(40, 30)):
    """Return the data of a message, shape (nx, ny)."""
    return np.reshape(msg.data, shape[::-1]).T


def test_values_become_cells():
    values = np.array([[0, 24, 25, 64], [65, 100, -1, 10], [0, 0, 0, 99]])
    message = make_message(values, 0.25, (1.0, -2.0))
    workspace = Workspace.from_occupancy_grid(message)
    assert workspace.grid == cspace.Grid((1.0, -2.0), 0.25, (4, 3))
    assert (workspace.outer == ((values >= 25) | (values < 0)).T).all()
    assert (workspace.unknown == ((values < 0) | ((values >= 25) & (values < 65))).T).all()
    message.data = values.ravel().tolist()
    free = Workspace.from_occupancy_grid(message, "free", free_thresh=0.995, occupied_thresh=1)
    assert (free.outer == (values == 100).T).all()


@pytest.mark.parametrize("kind", ["b", "B"])
def test_values_beyond_per_cent_warn_and_are_unknown(kind):
    message = make_message([[0, 100, -1, 0]])
    message.data = array(kind, [0, 100, 101, 127])
    with pytest.warns(UserWarning, match="2 values are beyond -1 to 100"):
        workspace = Workspace.from_occupancy_grid(message)
    assert workspace.unknown[:, 0].tolist() == [False, False, True, True]


@given(
    yaw=st.sampled_from([0.0, math.pi / 2, math.pi, -2.0]) | st.floats(-math.pi, math.pi),
    unknown=st.sampled_from(["occupied", "free"]),
    seed=seeds,
)
def test_a_message_agrees_with_the_map_file(tmp_path_factory, yaw, unknown, seed):
    yaw = 2.0 * math.atan2(math.sin(yaw / 2), math.cos(yaw / 2))  # rounded like the message's
    values = np.random.default_rng(seed).choice([0, 100, -1], (7, 9), p=[0.6, 0.2, 0.2])
    pixels = np.select([values == 0, values == 100], [254, 0], 205).astype(np.uint8)
    folder = tmp_path_factory.getbasetemp()
    Image.fromarray(pixels[::-1]).save(folder / "map.pgm")
    (folder / "map.yaml").write_text(
        f"image: map.pgm\nresolution: 0.05\norigin: [-1.5, 2.5, {yaw!r}]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.19\n"
    )
    saved = Workspace.from_ros_map(folder / "map.yaml", unknown)
    single = float(np.float32(0.05))  # the type on the wire
    message = make_message(values, single, (-1.5, 2.5), yaw)
    workspace = Workspace.from_occupancy_grid(message, unknown)
    assert np.allclose(workspace.grid.lower, saved.grid.lower, atol=1e-12)
    assert (workspace.grid.spacing, workspace.grid.shape) == (0.05, saved.grid.shape)
    assert (workspace.outer == saved.outer).all()
    assert (workspace.inner == saved.inner).all()


def test_a_map_survives_its_message(spaces):
    space = spaces["disc"]
    assert np.unique(space.cell_states).tolist() == [FREE, MIXED, BLOCKED]
    msg = make_strict("info", ("width", "height"), "b")
    assert space.to_occupancy_grid(msg, frame_id="odom") is msg
    assert msg.header.frame_id == "odom"
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


def change(path, value):
    """Make a message of 3 x 2 cells with a changed field."""
    message = make_message(np.zeros((2, 3), int))
    *parents, last = path.split(".")
    target = message
    for name in parents:
        target = getattr(target, name)
    setattr(target, last, value)
    return message


def test_an_unset_quaternion_is_no_rotation():
    message = change("info.origin.orientation.w", 0.0)
    assert Workspace.from_occupancy_grid(message).grid.shape == (3, 2)


@refusals(
    "msg, options, message",
    (
        SimpleNamespace(info=SimpleNamespace(width=2), data=[]),
        {},
        r"msg\.info has no height; .* besides width",
    ),
    (change("info.origin.position.x", math.inf), {}, r"msg\.info\.origin\.position has the x inf"),
    (
        change("info.origin.orientation.x", 1.0),
        {},
        r"orientation is \(1, 0, 0, 1\), which is tilted",
    ),
    (change("data", [0, 0, "..."]), {}, r"last of the data '\.\.\.'"),
    (change("data", [0.0] * 6), {}, "has data of shape .* float64; .* whole numbers"),
    (change("data", "AAA*"), {}, r"msg has the data 'AAA\*'"),
    (change("info.resolution", math.nan), {}, r"msg\.info has the resolution nan"),
    (change("info.resolution", "5 cm"), {}, "resolution '5 cm'; .*"),
    (change("info.width", True), {}, "has the width True"),
    (change("info.width", 2.5), {}, "has the width 2.5; it must be a whole number"),
    ({}, {}, "msg has no info; it must have one, besides nothing"),
    ({"metadata": {}}, {}, "msg is a Costmap; its data are costs"),
    (make_message([[0]]), {"unknown": "maybe"}, "unknown is 'maybe'"),
)
def test_from_occupancy_grid_refuses_in_one_line(msg, options, message):
    with pytest.raises(InputError, match=message) as caught:
        Workspace.from_occupancy_grid(msg, **options)
    assert "\n" not in str(caught.value)


def test_flags_instead_of_per_cent_warn():
    message = make_message([[0, 1, 0]])
    with pytest.warns(UserWarning, match="no value is above 1 per cent"):
        assert not Workspace.from_occupancy_grid(message).outer.any()
    message.data = [100 * value for value in message.data]
    assert Workspace.from_occupancy_grid(message).outer[:, 0].tolist() == [False, True, False]


# ---- poses and updates ---------------------------------------------------------------------------


def make_pose(x=1.0, y=2.5, yaw=0.3, frame="map", **turn):
    """Make a stamped pose."""
    half = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
    orientation = SimpleNamespace(**half | turn)
    pose = SimpleNamespace(position=SimpleNamespace(x=x, y=y, z=0.0), orientation=orientation)
    return SimpleNamespace(header=SimpleNamespace(frame_id=frame), pose=pose)


def test_a_pose_becomes_a_configuration(spaces):
    q = cspace.ros.configuration_of(make_pose(yaw=-3.0), spaces["car"])
    np.testing.assert_allclose(q, (1.0, 2.5, -3.0))
    assert cspace.ros.configuration_of(make_pose(), spaces["disc"]) == (1.0, 2.5)
    turning = build_empty(
        (4, 4, 4),
        Robot.box((0.2, 0.2, 0.2)),
        spacing=0.5,
        rotations=cspace.Rotations.quaternions(1),
    )
    tilted = make_pose(yaw=0.0, x=0.0, w=0.6)
    tilted.pose.orientation.x = 0.8
    q = cspace.ros.configuration_of(tilted, turning)
    assert q == (0.0, 2.5, 0.0, 0.8, 0.0, 0.0, 0.6)


@refusals(
    "pose, message",
    (
        make_pose(frame="odom"),
        "it must be 'map', the frame of the map",
    ),
    (make_pose(x=math.nan), "msg.pose.position"),
    (make_pose(w=math.inf), "msg.pose.orientation"),
    (make_pose(x=1.0, z=0.0, w=0.8), "no unit quaternion"),
)
def test_poses_of_another_kind_are_refused(spaces, pose, message):
    with pytest.raises(InputError, match=message):
        cspace.ros.configuration_of(pose, spaces["car"])


def test_a_tilted_pose_is_refused(spaces):
    tilted = make_pose(z=0.0, w=0.8)
    tilted.pose.orientation.x = 0.6
    for space in spaces.values():
        with pytest.raises(
            InputError, match=r"which is tilted; .*; project it with tilt_tolerance=1\.288"
        ):
            cspace.ros.configuration_of(tilted, space)


@pytest.mark.parametrize("tilt", [0.0, 0.03, -0.049])
def test_a_small_tilt_is_projected_if_asked_for(spaces, tilt):
    yaw = 0.7
    leaning = Rotation.from_euler("zx", (yaw, tilt))
    pose = make_pose()
    for name, value in zip("xyzw", leaning.as_quat().tolist(), strict=True):
        setattr(pose.pose.orientation, name, value)
    q = cspace.ros.configuration_of(pose, spaces["car"], tilt_tolerance=0.05)
    assert q[2] == pytest.approx(yaw)
    if tilt:
        with pytest.raises(InputError, match="which is tilted"):
            cspace.ros.configuration_of(pose, spaces["car"], tilt_tolerance=0.9 * abs(tilt))


def make_update(x, y, values):
    """Make an update of a box of cells, shape (height, width)."""
    height, width = np.shape(values)
    header = SimpleNamespace(frame_id="")
    box = {"x": x, "y": y, "width": width, "height": height}
    return SimpleNamespace(header=header, **box, data=np.ravel(values).tolist())


@given(seeds)
def test_an_updated_message_has_the_new_values(seed):
    rng = np.random.default_rng(seed)
    values = rng.integers(-1, 101, rng.integers(1, 9, 2), dtype=np.int8)
    message = make_message(values)
    height, width = rng.integers(1, np.array(values.shape) + 1)
    y, x = (
        int(rng.integers(0, n - m + 1)) for n, m in zip(values.shape, (height, width), strict=True)
    )
    box = rng.integers(-1, 101, (height, width), dtype=np.int8)
    cspace.ros.update_occupancy_grid(message, make_update(x, y, box))
    values[y : y + height, x : x + width] = box
    np.testing.assert_array_equal(np.reshape(message.data, values.shape), values)


@refusals(
    "update, message",
    (
        make_update(3, 0, [[0, 0]]),
        "lie in the grid of 4 x 3 cells|lie in the grid of 4 x 3",
    ),
    (make_update(-1, 0, [[0, 0]]), "update has the x -1; it must be a finite number, at least 0"),
    (SimpleNamespace(width=1, height=1, x=0, y=0, data=[0, 1]), "update has data of shape"),
    (
        {"header": {}},
        "update has no width; it must have one, besides header",
    ),
)
def test_updates_beyond_the_grid_are_refused(update, message):
    grid = make_message(np.zeros((3, 4), dtype=np.int8))
    with pytest.raises(InputError, match=message):
        cspace.ros.update_occupancy_grid(grid, update)
    assert not any(grid.data)


# ---- mappings, files and frames ------------------------------------------------------------------


def make_grid(frame_id="odom", values=None):
    """Make a grid message of cells of 0.1 m, shape (height, width); by default all are free."""
    values = np.zeros((20, 30), int) if values is None else values
    grid = cspace.ros.OccupancyGrid()
    grid.header.frame_id = frame_id
    grid.info.height, grid.info.width = np.shape(values)
    grid.info.resolution = 0.1
    grid.data.extend(np.ravel(values).tolist())
    return grid


def as_mapping(message):
    """Return a message as rosbridge sends it."""
    return json.loads(json.dumps(message, default=lambda x: getattr(x, "__dict__", None) or [*x]))


def test_a_mapping_and_a_file_are_read_like_the_message(tmp_path):
    values = np.random.default_rng(0).choice([0, 100, -1], (20, 30))
    message = make_grid("/odom", values)
    expected = Workspace.from_occupancy_grid(message)
    file = tmp_path / "grid.yaml"
    file.write_text(f"{json.dumps(as_mapping(message))}\n---\n")
    for source in (as_mapping(message), file):
        workspace = Workspace.from_occupancy_grid(source)
        assert workspace.grid == expected.grid
        assert workspace.grid.frame_id == expected.grid.frame_id == "odom"
        assert (workspace.outer == expected.outer).all()
    # The header may be missing, and the frame is then unknown.
    assert (
        Workspace.from_occupancy_grid(
            {key: value for key, value in as_mapping(message).items() if key != "header"}
        ).grid.frame_id
        == ""
    )


def test_poses_and_updates_may_be_mappings(spaces):
    pose = as_mapping(make_pose())
    assert cspace.ros.configuration_of(pose, spaces["car"]) == cspace.ros.configuration_of(
        make_pose(), spaces["car"]
    )
    grid = as_mapping(make_grid(values=[[0, 0, 0]]))
    cspace.ros.update_occupancy_grid(grid, as_mapping(make_update(1, 0, [[100, -1]])))
    assert grid["data"] == [0, 100, -1]
    frozen = types.MappingProxyType(grid)
    with pytest.raises(InputError, match="msg cannot be written to"):
        cspace.ros.update_occupancy_grid(frozen, make_update(0, 0, [[50]]))
    copy = dict(frozen)
    cspace.ros.update_occupancy_grid(copy, make_update(0, 0, [[50]]))
    assert copy["data"] == [50, 100, -1]
    assert grid["data"] == [0, 100, -1]


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
    assert cspace.TiledCSpace.open(tmp_path / "tiles.zarr").frame_id == tiled.frame_id == "odom"
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


def test_poses_and_updates_in_another_frame_are_refused(odom):
    space, _ = odom
    pose = make_pose(x=1.0, y=1.0)
    rule = "frame_id is 'map'; it must be 'odom', the frame of the map"
    with pytest.raises(InputError, match=rf"msg\.header\.{rule}"):
        cspace.ros.configuration_of(pose, space)
    assert cspace.ros.configuration_of(pose, space, "map") == (1.0, 1.0)
    pose.header.frame_id = "odom"  # as transformed
    assert cspace.ros.configuration_of(pose, space) == (1.0, 1.0)
    grid, update = make_grid(), make_update(0, 0, [[100]])
    update.header.frame_id = "map"
    with pytest.raises(InputError, match=rf"update\.header\.{rule}"):
        cspace.ros.update_occupancy_grid(grid, update)
    assert not any(grid.data)
    for frame_id in ("/odom", ""):
        update.header.frame_id = frame_id
        cspace.ros.update_occupancy_grid(grid, update)
        assert grid.data[0] == 100
        grid.data[0] = 0


def test_a_map_is_not_updated_by_a_workspace_in_another_frame(odom):
    space, _ = odom
    other = Workspace.from_occupancy_grid(make_grid("map", np.full((20, 30), 100)))
    with pytest.raises(InputError, match="is in the frame 'map'; it must be 'odom',"):
        space.update(other)
    assert space.is_free((1.0, 1.0))
    same = cspace.build(other, Robot.disc(0.15))
    same.update(Workspace.from_array(np.zeros((30, 20), bool), 0.1))
    assert same.is_free((1.0, 1.0))
    assert same.to_costmap().header.frame_id == "map"


def test_fields_of_a_mapping_that_are_not_read_are_named():
    grid = as_mapping(make_grid())
    grid["info"]["origin"]["orientaton"] = grid["info"]["origin"].pop("orientation")
    with pytest.raises(InputError, match=r"msg\.info\.origin has no orientation; .* orientaton"):
        Workspace.from_occupancy_grid(grid)
    grid = as_mapping(make_grid()) | {"unknown_value": 255}
    grid["info"]["scale"] = 2.0
    with pytest.warns(UserWarning, match=r"are not read: scale \(info\), unknown_value"):
        Workspace.from_occupancy_grid(grid)
