"""Pages of all kinds of maps, tested through the server."""

from __future__ import annotations

import itertools
import socket
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

import cspace
import planners
from cspace.errors import InputError
from cspace.view import Viewer
from cspace.view._viewer import is_same_site
from tests.helpers.commands import run
from tests.helpers.pages import connected, node
from tests.helpers.refusals import refusals
from tests.helpers.waiting import until

pytest.importorskip("viser")

NOSED = cspace.Robot.polygon([(-0.1, -0.1), (0.2, 0.0), (-0.1, 0.1)])
KINDS = {
    "R2": (cspace.Robot.disc(0.1), None),
    "SE2": (NOSED, 12),
    "R3": (cspace.Robot.ball(0.1), None),
    "SE3": (cspace.Robot.box((0.2, 0.1, 0.1)), cspace.Rotations.quaternions(2)),
    "floor": (cspace.Robot.box((0.2, 0.1, 0.3)), 12),
}
"""Robot and rotation cells of each kind of map."""


def build_room(kind):
    """Build a map of a room with a column."""
    robot, rotations = KINDS[kind]
    occupied = np.zeros((24, 20, 12)[: robot.dim], dtype=bool)
    occupied[11:13, 9:12] = True
    floor = 0.5 if kind == "floor" else None
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    return cspace.build(workspace, robot, rotations=rotations, floor=floor)


@pytest.fixture(scope="module", params=KINDS)
def viewed(request):
    space = build_room(request.param)
    with space.view(block=False, port=0) as viewer:
        yield request.param, space, viewer


def test_the_whole_map_is_in_view_on_a_phone(viewed):
    """Project the corners of the map with the camera of a page half as wide as high."""
    _, space, viewer = viewed
    center = np.array(viewer.server.initial_camera.look_at)
    near = np.linalg.norm(np.array(viewer.server.initial_camera.position) - center)

    def find_camera():
        cameras = [client.camera for client in viewer.server.get_clients().values()]
        # The page sends place and view one after the other.
        seen = (c for c in cameras if np.allclose(c.look_at, center))
        far = (c for c in seen if np.linalg.norm(c.position - c.look_at) > 1.01 * near)
        return next(far, None)

    with connected(viewer, image_width=400, image_height=800):
        camera = until(find_camera, seconds=30.0)
        assert camera.look_at == pytest.approx(center)
        ahead = (center - camera.position) / np.linalg.norm(center - camera.position)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        low, high = np.zeros(3), np.zeros(3)
        low[: space.grid.dim], high[: space.grid.dim] = space.grid.lower, space.grid.upper
        for corner in itertools.product(*zip(low, high, strict=True)):
            way = np.array(corner) - camera.position
            half = np.tan(0.5 * viewer.server.initial_camera.fov) * (way @ ahead)
            assert abs(way @ right) <= 0.5 * half
            assert abs(way @ np.cross(right, ahead)) <= half


@pytest.mark.parametrize("taken_as_free", [False, True], ids=["occupied", "free"])
def test_unknown_cells_are_obstacles_of_the_page_only_if_they_are_occupied(taken_as_free):
    outer = np.zeros((24, 20), dtype=bool)
    outer[11:13, 9:12] = True
    unknown = np.zeros_like(outer)
    unknown[2:4, 2:4] = True
    if not taken_as_free:
        outer |= unknown
    grid = cspace.Grid((0.0, 0.0), 0.1, outer.shape)
    workspace = cspace.Workspace(grid, outer, outer, source="sensor", unknown=unknown)
    space = cspace.build(workspace, cspace.Robot.disc(0.1))
    with space.view(block=False, port=0) as viewer:
        assert ("unknown" in viewer.canvas.kinds) != taken_as_free
        labels = [label for label, _ in viewer.canvas.legend if "unknown" in label]
        assert labels == [f"unknown, taken as {'free' if taken_as_free else 'obstacle'}"]


def test_the_scene_follows_the_robot_and_the_choices(viewed):
    _, space, viewer = viewed
    page = viewer.page
    dim = space.grid.dim
    assert page.wait(600.0)
    drawn = {name: node(viewer, f"/{name}") for name in ("section", "obstacles")}
    assert all(drawn.values()) and node(viewer, "/start") and node(viewer, "/goal")
    viewer.canvas.draw()
    assert all(node(viewer, f"/{name}") is handle for name, handle in drawn.items())
    free = space.sample_free(8, np.random.default_rng(0))
    for q in free:
        page.move(q)
        assert page.wait(600.0)
        assert page.panel.state.content.startswith("**FREE**")
        np.testing.assert_allclose(node(viewer, "/robot").position[:dim], q[:dim])
    # Only another rotation cell makes new drawings.
    turned = len(np.unique(space.rotations._find_cells(free))) > 1
    assert (node(viewer, "/section") is not drawn["section"]) == turned
    assert node(viewer, "/obstacles") is drawn["obstacles"]
    for label in ("obstacle", "undecided (MIXED)"):
        page.panel.shown[label].value ^= True
    until(lambda: node(viewer, "/mixed") and not node(viewer, "/obstacles"))


def test_a_robot_on_a_floor_stands_in_its_scene():
    space = build_room("floor")
    with space.view(block=False, port=0, path=[(0.5, 0.5, 0.0), (2.0, 0.5, 0.0)]) as viewer:
        canvas = viewer.canvas
        assert viewer.page.wait(600.0)
        assert node(viewer, "/robot").position[2] == node(viewer, "/start").position[2] == 0.5
        heights = node(viewer, "/robot/body").vertices[:, 2]
        np.testing.assert_allclose((heights.min(), heights.max()), (-0.15, 0.15), atol=1e-6)
        assert (canvas._path_positions(np.zeros((1, 3)))[:, 2] > 0.5).all()
        assert canvas.cut == pytest.approx(0.65)  # the top of the robot
        assert "cut at z (m)" in viewer.page.panel.shown


def test_a_page_shows_plans_proofs_and_errors(viewed):
    _, space, viewer = viewed
    page = viewer.page
    goal = page.endpoints["goal"]
    page.search()
    assert page.wait(600.0)
    assert page.panel.proof.content == "**A path exists: proven.**"
    assert viewer.plan is not None and viewer.plan.certified
    assert "certified" in page.panel.answer.content
    assert node(viewer, "/path")
    page.go(1.0)
    steps = space.rotations.steps_between(viewer.canvas.robot, goal)
    np.testing.assert_allclose(steps, 0.0, atol=1e-6)
    page.set_endpoint("goal", np.array([1e3, *goal[1:]]))
    page.search()
    assert page.wait(600.0)
    assert "lies outside the map" in page.panel.answer.content


def test_a_page_proves_that_no_path_exists_until_the_map_changes():
    occupied = np.zeros((30, 20), dtype=bool)
    occupied[14:16] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.2))
    with space.view(block=False, port=0, start=(0.7, 1.0), goal=(2.3, 1.0)) as viewer:
        page = viewer.page
        page.search()
        assert page.wait(600.0)
        assert page.panel.proof.content == "**No path exists: proven.**"
        assert page.panel.answer.content == "**No path exists: proven.**"
        space.update(np.zeros((2, 20), dtype=bool), (14, 0))
        viewer.refresh()
        assert page.wait(600.0)
        assert page.panel.proof.content == "**A path exists: proven.**"
        assert not node(viewer, "/obstacles")
        assert repr(viewer) == f"Viewer({viewer.url})"
        assert viewer.url in viewer._repr_html_()
    assert "closed" in viewer._repr_html_()


def test_the_page_of_a_tiled_map_proves_and_plans(tmp_path):
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[20, :15] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    tiled = cspace.build(workspace, cspace.Robot.disc(0.2), store=tmp_path / "m", tile=16)
    with tiled.view(block=False, port=0, start=(0.6, 0.6), goal=(3.4, 0.6)) as viewer:
        viewer.page.search()
        assert viewer.page.wait(600.0)
        assert viewer.page.panel.proof.content == "**A path exists: proven.**"
        assert viewer.plan is not None and viewer.plan.certified
        assert node(viewer, "/section") and node(viewer, "/path")


@pytest.mark.parametrize("has_times", [True, False], ids=["trajectory", "path"])
def test_paths_are_played_at_true_speed_or_in_eight_seconds(has_times, monkeypatch):
    """Replace the clock, so that each frame has an exact time."""
    space = build_room("R2")
    plan = planners.plan(space, (0.5, 0.5), (2.0, 0.5))
    trajectory = plan.trajectory(max_velocity=2.0, max_acceleration=8.0)
    now = [0.0]

    def sleep(seconds):
        now[0] += seconds

    clock = SimpleNamespace(perf_counter=lambda: now[0], sleep=sleep)
    path = trajectory if has_times else plan.path
    with space.view(path=path, block=False, port=0) as viewer:
        frames = []
        monkeypatch.setattr("cspace.view._page.time", clock)
        monkeypatch.setattr(viewer.canvas, "place", lambda q: frames.append((now[0], q)))
        viewer.page.play()
        until(lambda: frames and np.allclose(frames[-1][1], (2.0, 0.5)))
        assert len(frames) > 10
        for seconds, q in frames:
            on_path = (0.5 + 1.5 * min(seconds / 8.0, 1.0), 0.5)
            expected = trajectory.sample(seconds)[0] if has_times else on_path
            np.testing.assert_allclose(q, expected, atol=1e-9)


def test_a_page_closes_after_its_proof_and_its_stopped_search(monkeypatch, recwarn):
    """The search ends only because it is stopped."""
    began = [threading.Event(), threading.Event()]

    def prove(*_):
        began[0].set()
        time.sleep(0.2)
        return "proven"

    def search(*_, stop, **__):
        began[1].set()
        until(stop)
        raise InputError("stop", "is set", "the search ends", "")

    with build_room("R2").view(block=False, port=0) as viewer:
        assert viewer.page.wait(600.0)
        monkeypatch.setattr(viewer.canvas, "prove", prove)
        monkeypatch.setattr(planners, "plan", search)
        viewer.page.refresh()
        viewer.page.search()
        assert all(event.wait(60.0) for event in began)
    assert viewer.page.panel.proof.content == "proven"
    assert viewer.page.wait(60.0) and not recwarn.list


def test_the_command_opens_a_page(tmp_path, monkeypatch, capfd):
    space = build_room("R2")
    space.save(tmp_path / "map.zarr")
    seen = []

    def enter(viewer):
        seen.append(viewer)
        viewer.close()

    monkeypatch.setattr(Viewer, "__enter__", enter)
    printed = run("view --port 0 --goal 1.75,0.5", tmp_path / "map.zarr")
    assert seen[0].url.startswith("http://127.0.0.1:")
    assert printed.stdout == f"{seen[0].url}  Ctrl-C closes it\n"
    assert "viser" not in "".join(capfd.readouterr())
    np.testing.assert_allclose(seen[0].page.endpoints["goal"], (1.75, 0.5))


# ---- refusals ------------------------------------------------------------------------------------


@refusals(
    "options, message",
    ({"port": True}, "port is True"),
    ({"port": 10**6}, "it must be a whole number from 0 to 65535"),
    ({"host": "198.51.100.7", "port": 0}, "address of this machine"),
    ({"path": np.zeros((3, 3))}, "path has shape"),
    ({"start": (0.0,)}, "start has shape"),
    ({"goal": (0.0, np.nan)}, "goal"),
    ({"frame": "tool0"}, "a map has no frames"),
)
def test_view_refuses_invalid_arguments(options, message):
    with pytest.raises(InputError, match=message):
        build_room("R2").view(block=False, **options)


def test_view_refuses_a_port_that_is_taken():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port is {port}; other programs use it"):
            build_room("R2").view(block=False, port=port)


@pytest.mark.parametrize(
    "origin, asked, host, same",
    [
        (None, "127.0.0.1:8080", "127.0.0.1", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", "127.0.0.1", True),
        ("http://robot.example:8080", "robot.example:8080", "0.0.0.0", True),
        ("http://localhost:1", "localhost:8080", "127.0.0.1", False),
        # The owner of the name may resolve it to 127.0.0.1.
        ("http://example.org:8080", "example.org:8080", "127.0.0.1", False),
        ("null", "127.0.0.1:8080", "127.0.0.1", False),
    ],
)
def test_only_pages_of_the_server_are_of_its_site(origin, asked, host, same):
    assert is_same_site(origin, asked, host) == same


def test_the_server_closes_connections_of_other_sites():
    import viser
    from websockets.exceptions import ConnectionClosedError
    from websockets.sync.client import connect

    protocol = f"viser-v{viser.__version__}"
    foreign = "http://example.org"
    with build_room("R2").view(block=False, port=0) as viewer:
        url = viewer.url.replace("http", "ws")
        with (
            connect(url, origin=foreign, subprotocols=[protocol]) as client,
            pytest.raises(ConnectionClosedError, match="another site"),
        ):
            while True:
                client.recv(timeout=600.0)
