"""Pages of all kinds of maps, tested through the server."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cspace
from cspace.errors import InputError
from cspace.view import Viewer
from tests.helpers.commands import run
from tests.helpers.missing import output_without
from tests.helpers.pages import camera, node, setting
from tests.helpers.refusals import refusals
from tests.helpers.waiting import until

pytest.importorskip("viser")

VIEWED_SPACES = {
    "R2": (2, cspace.Robot.disc(0.1), None),
    "SE2": (2, cspace.Robot.polygon([(-0.1, -0.1), (0.2, 0.0), (-0.1, 0.1)]), 12),
    "R3": (3, cspace.Robot.ball(0.1), None),
    "R3xSO2": (3, cspace.Robot.box((0.3, 0.1, 0.1), center=(0.05, 0.0, 0.0)), 12),
    "SE3": (3, cspace.Robot.box((0.2, 0.1, 0.1)), cspace.Rotations.quaternions(2)),
}


def build_room(kind: str) -> cspace.CSpace:
    """Build a map of a room with a column."""
    dim, robot, rotations = VIEWED_SPACES[kind]
    occupied = np.zeros((24, 20, 12)[:dim], dtype=bool)
    occupied[11:13, 9:12] = True
    return cspace.build(cspace.Workspace.from_array(occupied, 0.1), robot, rotations=rotations)


@pytest.fixture(scope="module", params=VIEWED_SPACES)
def viewer(request: pytest.FixtureRequest) -> Iterator[tuple[cspace.CSpace, Viewer]]:
    space = build_room(request.param)
    with space.view(block=False, port=0) as viewer:
        yield space, viewer


def test_sliders_match_the_axes_of_the_map(viewer: Any) -> None:
    space, page = viewer
    angles = {0: [], 1: ["yaw (°)"], 4: ["roll (°)", "pitch (°)", "yaw (°)"]}[
        len(space.rotations.names)
    ]
    sliders = [f"{axis} (m)" for axis in "xyz"[: space.grid.dim]] + angles
    assert [slider.label for slider in page.page.panel.sliders] == sliders
    assert ("cut at z (m)" in page.page.panel.shown) == (space.grid.dim == 3)
    assert (
        "unknown, taken as obstacle" not in page.page.panel.shown
    )  # the workspace has no unknown cells


def test_scene_follows_the_robot_and_the_choices(viewer: Any) -> None:
    space, page = viewer
    assert page.page.wait(60.0)
    assert all(node(page, name) for name in ("/robot", "/start", "/goal", "/section", "/obstacles"))

    drawn = {name: node(page, name) for name in ("/section", "/border", "/obstacles")}
    page.canvas.draw()  # nothing is sent twice
    assert all(node(page, name) is handle for name, handle in drawn.items())
    free = space.sample_free(8, np.random.default_rng(0))
    for q in free:
        page.page.move(q)
        assert page.page.wait(60.0)
        assert page.page.panel.state.content.startswith("**FREE**")
        np.testing.assert_allclose(
            node(page, "/robot").position[: space.grid.dim], q[: space.grid.dim]
        )
    turned = len({int(space.rotations.find_cells(q)) for q in free}) > 1
    # Only the rotation changes the cells; each drawing makes a new handle.
    assert any(node(page, name) is not handle for name, handle in drawn.items()) == turned
    for label in ("obstacle", "undecided (MIXED)"):
        page.page.panel.shown[label].value ^= True
    until(lambda: node(page, "/mixed") and not node(page, "/obstacles"))


def test_a_page_opens_with_a_cut_above_the_robot_if_nothing_covers_the_path() -> None:
    space = build_room("R3")
    with space.view(block=False, port=0, path=[(0.45, 0.45, 0.35), (1.95, 0.45, 0.75)]) as viewer:
        assert viewer.page.panel.shown["cut at z (m)"].value == pytest.approx(
            0.9
        )  # in steps of 0.1 m


def test_a_page_shows_plans_and_proofs(viewer: Any) -> None:
    space, page = viewer
    start, goal = page.page.marks["start"], page.page.marks["goal"]
    assert space.is_connected(start, goal)
    page.page.search()
    assert page.page.wait(60.0)
    assert page.page.panel.proof.content == "**A path exists: proven.**"
    assert page.plan is not None
    assert page.plan.solved
    assert "certified" in page.page.panel.answer.content
    assert node(page, "/path")
    page.page.go(1.0)
    np.testing.assert_allclose(
        space.rotations.steps_between(page.canvas.robot, goal), 0.0, atol=1e-6
    )
    page.page.mark("goal", np.array([1e3, *goal[1:]]))
    page.page.search()
    assert page.page.wait(60.0)
    assert "lies outside the map" in page.page.panel.answer.content  # and the page stays usable
    page.page.mark("goal", goal)
    assert page.page.wait(60.0)


@pytest.mark.parametrize("drive", ["differential", "dubins"])
def test_drive_applies_to_plane_robots_with_yaw(viewer: Any, drive: str) -> None:
    space, page = viewer
    chosen, radius = page.page.panel.drive, page.page.panel.turning_radius
    assert chosen.visible == (space.axes == ("x", "y", "yaw"))
    if chosen.visible:
        chosen.value, radius.value = drive, 0.2
        until(lambda: radius.visible == (drive == "dubins"))
        page.page.search()
        assert page.page.wait(60.0)
        assert (page.plan.drive, page.plan.turning_radius) == (
            drive,
            0.2 if radius.visible else None,
        )
        assert (
            page.plan.certified or drive == "dubins"
        )  # a car that cannot reverse may not reach the goal
        chosen.value = "holonomic"


def test_page_shows_the_proof_that_no_path_exists() -> None:
    occupied = np.zeros((30, 20), dtype=bool)
    occupied[14:16] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.2))
    with space.view(block=False, port=0, start=(0.7, 1.0), goal=(2.3, 1.0)) as viewer:
        assert viewer.page.wait(60.0)
        assert viewer.page.panel.proof.content == "**No path exists: proven.**"
        viewer.page.search()
        assert viewer.page.wait(60.0)
        assert viewer.page.panel.answer.content == "**No path exists: proven.**"
        space.update(np.zeros((2, 20), dtype=bool), (14, 0))
        viewer.refresh()
        assert viewer.page.wait(60.0)
        assert viewer.page.panel.proof.content == "**A path exists: proven.**"
        assert not node(viewer, "/obstacles")
        assert repr(viewer) == f"Viewer({viewer.url})"
        assert viewer.url in viewer._repr_html_()
    viewer.close()
    assert "closed" in viewer._repr_html_()


def test_page_of_a_tiled_map_proves_and_plans(tmp_path: Path) -> None:
    occupied = np.zeros((40, 30), dtype=bool)
    occupied[20, :15] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    stored = cspace.build(workspace, cspace.Robot.disc(0.2), store=tmp_path / "map.zarr", tile=16)
    with stored.view(block=False, port=0, start=(0.6, 0.6), goal=(3.4, 0.6)) as viewer:
        assert viewer.page.wait(60.0)
        assert viewer.page.panel.proof.content == "**A path exists: proven.**"
        viewer.page.search()
        assert viewer.page.wait(60.0)
        assert viewer.page.panel.proof.content == "**A path exists: proven.**"
        assert viewer.plan is not None
        assert viewer.plan.solved
        assert "Not done" not in viewer.page.panel.answer.content
        assert node(viewer, "/section") and node(viewer, "/path")


def test_view_refuses_a_port_that_is_taken_and_a_path_of_another_map(tmp_path: Path) -> None:
    space = build_room("R2")
    space.save(tmp_path / "map.zarr")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(
            InputError, match=f"port is {port}; other programs use it; pass another"
        ):
            space.view(block=False, port=port)
        printed = run("view", tmp_path / "map.zarr", "--port", port)
        assert (printed.exit_code, printed.stderr.count("\n")) == (2, 1)
        assert printed.stderr.startswith(f"cspace: --port is {port}")
    (tmp_path / "path.csv").write_text("x,y,z\n0,0,0\n1,1,1\n")
    printed = run("view", tmp_path / "map.zarr", "--path", tmp_path / "path.csv")
    assert printed.exit_code == 2
    assert "the map's axes are x, y" in printed.stderr


@refusals(
    "options, message",
    ({"port": 70_000}, "port is 70000"),
    ({"port": True}, "port is True"),
    ({"host": "198.51.100.7", "port": 0}, "address of this machine"),
    ({"path": np.zeros((3, 3))}, "path has shape"),
    ({"start": (0.0,)}, "start has shape"),
    ({"goal": (0.0, np.nan)}, "goal"),
)
def test_view_refuses_invalid_arguments(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        build_room("R2").view(block=False, **options)


def test_the_command_opens_a_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    space = build_room("R2")
    space.save(tmp_path / "map.zarr")
    free = space.sample_free(2, np.random.default_rng(0))
    (tmp_path / "path.csv").write_text(
        "x,y\n" + "\n".join(f"{x},{y}" for x, y in free.tolist()) + "\n"
    )
    seen: list[Viewer] = []

    def wait(viewer: Viewer) -> None:
        seen.append(viewer)
        viewer.page.wait(60.0)
        assert node(viewer, "/path")
        viewer.close()

    monkeypatch.setattr(Viewer, "wait", wait)
    printed = run("view", tmp_path / "map.zarr", "--path", tmp_path / "path.csv", "--port", 0)
    assert printed.exit_code == 0, printed.stderr
    assert seen[0].url.startswith("http://127.0.0.1:")
    assert f"{seen[0].url}  Ctrl-C closes it\n" in printed.stdout
    assert "viser" not in printed.stdout + "".join(capfd.readouterr())
    np.testing.assert_allclose(seen[0].page.marks["goal"], free[1])


def test_view_without_viser_names_the_extra() -> None:
    code = """
space = cspace.build(cspace.Workspace.from_array(np.zeros((9, 9), bool), 0.1), cspace.Robot.disc(0.1))
try:
    space.view(block=False)
except cspace.MissingPackageError as error:
    print(error)
"""
    assert 'pip install "cspace[view]"' in output_without("viser", code)


@pytest.mark.parametrize(
    ("origin", "host", "moves"),
    [
        (None, "127.0.0.1", True),
        ("http://{}", "127.0.0.1", True),
        ("http://{}", "localhost", True),
        ("http://example.org", "127.0.0.1", False),
        ("http://localhost:1", "localhost", False),
        ("http://{}", "example.org", False),  # its owner may resolve it to 127.0.0.1
        ("null", "127.0.0.1", False),
    ],
)
def test_server_refuses_pages_of_other_sites(
    served: Viewer, origin: str | None, host: str, moves: bool
) -> None:
    import msgspec
    import viser
    from websockets.exceptions import ConnectionClosedError
    from websockets.frames import CloseCode
    from websockets.sync.client import connect

    page, port = served.page, served.server.get_port()
    q = page.marks["start"] + [0.3, 0.3]
    page.move(page.marks["start"])
    sent = [camera()]
    sent += [
        setting(slider, value) for slider, value in zip(page.panel.sliders, q.tolist(), strict=True)
    ]
    with (
        socket.create_connection(("127.0.0.1", port)) as plug,
        connect(
            f"ws://{host}:{port}",
            sock=plug,
            origin=origin and origin.format(f"{host}:{port}"),  # type: ignore[arg-type]
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
        ) as client,
    ):
        with nullcontext() if moves else pytest.raises(ConnectionClosedError) as refused:
            for message in sent:
                client.send(msgspec.msgpack.encode(message))
            while not moves:
                client.recv(timeout=20.0)
        assert moves or refused.value.rcvd.code == CloseCode.POLICY_VIOLATION
        until(lambda: not moves or np.allclose(served.canvas.robot, q, atol=0.05))
    np.testing.assert_allclose(served.canvas.robot, q if moves else page.marks["start"], atol=0.05)


def test_trajectories_are_played_at_true_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    import planners

    space = build_room("R2")
    plan = planners.plan(space, (0.5, 0.5), (2.0, 0.5))
    trajectory = plan.trajectory(max_velocity=2.0, max_acceleration=8.0)
    with space.view(path=trajectory, block=False, port=0) as viewer:
        viewer.page.go(0.3)
        np.testing.assert_allclose(
            viewer.canvas.robot, trajectory.sample(0.3 * trajectory.duration)[0]
        )
        frames: list[tuple[float, float]] = []
        monkeypatch.setattr(
            viewer.page, "go", lambda share: frames.append((time.perf_counter(), share))
        )
        viewer.page.play()
        until(lambda: frames and frames[-1][1] == 1.0)
        (start, first), (ended, last) = frames[0], frames[-1]
        assert ended - start >= 0.99 * (last - first) * trajectory.duration
        assert ended - start < 4.0  # a path without times takes 8 s
        viewer.page._show_path(plan.path)
        viewer.page.panel.share.value = 0.0
        monkeypatch.undo()
        viewer.page.go(0.3)  # a share of the length again
        np.testing.assert_allclose(
            viewer.canvas.robot, plan.path[0] + 0.3 * (plan.path[-1] - plan.path[0]), atol=1e-9
        )


@pytest.fixture(scope="module")
def served() -> Iterator[Viewer]:
    with build_room("R2").view(block=False, port=0, start=(0.5, 0.5), goal=(2.0, 0.5)) as viewer:
        yield viewer
