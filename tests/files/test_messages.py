"""ROS messages without ROS."""

import json
import math
import types
from array import array
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation

import cspace
from cspace import InputError, Robot, Workspace
from tests.helpers.handmade import build_empty
from tests.helpers.messages import as_mapping, build_spaces, make_grid, make_message
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds


@pytest.fixture(scope="module")
def spaces():
    return build_spaces()


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
    saved = Workspace.open(folder / "map.yaml", unknown=unknown)
    single = float(np.float32(0.05))  # the type on the wire
    message = make_message(values, single, (-1.5, 2.5), yaw)
    workspace = Workspace.from_occupancy_grid(message, unknown)
    assert np.allclose(workspace.grid.lower, saved.grid.lower, atol=1e-12)
    assert (workspace.grid.spacing, workspace.grid.shape) == (0.05, saved.grid.shape)
    assert (workspace.outer == saved.outer).all()
    assert (workspace.inner == saved.inner).all()


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
    ({}, {}, "msg has no info; it must have one; it has no field at all"),
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


@pytest.fixture(scope="module")
def odom():
    """Return a map of a grid in the frame odom."""
    return cspace.build(Workspace.from_occupancy_grid(make_grid()), Robot.disc(0.15))


def test_poses_and_updates_in_another_frame_are_refused(odom):
    space = odom
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
    space = odom
    other = Workspace.from_occupancy_grid(make_grid("map", np.full((20, 30), 100)))
    with pytest.raises(InputError, match="is in the frame 'map'; it must be 'odom',"):
        space.update(other)
    assert space.is_free((1.0, 1.0))
    same = cspace.build(other, Robot.disc(0.15))
    same.update(Workspace.from_array(np.zeros((30, 20), bool), 0.1))
    assert same.is_free((1.0, 1.0))
    assert same.grid.frame_id == "map"


def test_fields_of_a_mapping_that_are_not_read_are_named():
    grid = as_mapping(make_grid())
    grid["info"]["origin"]["orientaton"] = grid["info"]["origin"].pop("orientation")
    with pytest.raises(InputError, match=r"msg\.info\.origin has no orientation; .* orientaton"):
        Workspace.from_occupancy_grid(grid)
    grid = as_mapping(make_grid()) | {"unknown_value": 255}
    grid["info"]["scale"] = 2.0
    with pytest.warns(UserWarning, match=r"are not read: scale \(info\), unknown_value"):
        Workspace.from_occupancy_grid(grid)
