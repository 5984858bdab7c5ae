"""Refusals of the command line: exit code 2, one line with options, no files."""

import os
from pathlib import Path

import pytest

from tests.helpers.commands import run

MAP = "map floor.npy --robot disc:0.05 --spacing 0.1 -o new.zarr"
MAP_CUBE = "map cube.obj --robot ball:0.1 -o new.zarr"
PLAN = "plan plane.zarr --start 0.35,0.65 --goal 2.15,0.95"
PLAN_TURNING = "plan turning.zarr --start 0.35,0.65,0 --goal 2.15,0.95,90deg"
PLOT = "plot plane.zarr -o new.png"

FILES = {
    "notes.txt": "nothing of use",
    "notes.csv": "x,y\nhere,there\n",
    "empty.csv": "x,y\n",
    "list.json": "[1, 2]",
    "swapped.csv": "y,x\n1,1\n",
    "wide.json": '{"path": [[1, 1, 0, 0, 0]]}',
    "old.png": "nothing of use",
    "old.pgm": "nothing of use",
    "precious/thesis.txt": "years of work",
    "broken.zarr/zarr.json": "{ nothing of use",
}
"""Texts of files that are in the way, or are no paths."""

REFUSED_COMMANDS = {
    # Options of the library's arguments
    f"{MAP_CUBE}": "--spacing is missing for cube.obj",
    f"{MAP} --spacing -0.1": "--spacing is -0.1",
    f"{MAP} --robot disk:0.3": "disk:0.3",
    f"{MAP} --robot ball:0.1": "--robot has 3 dimensions but the workspace has 2",
    f"{MAP} --rotations quaternions:2": "--rotations=72",
    f"{PLAN_TURNING} --drive dubins": "--turning-radius is missing",
    f"{PLAN} --goal nan,1": "--goal[1][0] is nan",
    f"{PLAN} --any-yaw": "--any-yaw is set, and the axes are x, y; the map has no rotations; omit it",
    f"{PLAN} --goal-tolerance 0.1,190deg": "an angle is at most pi radians",
    f"{PLAN} --goal-tolerance wide": "--goal-tolerance is 'wide'",
    f"{PLAN} --start 1.25,0.05": "BLOCKED",
    "plot space.zarr -o n.png --center 1,1,1 --view 3d": "--zoom=8",
    # Options of another kind of file
    f"{MAP} --robot-solid fill": "leave it out",
    f"{MAP} --package-dir .": "--package-dir is [PosixPath('.')] for disc:0.05",
    "info space.zarr --spacing 1": "--spacing is given, but space.zarr is read as map; omit it",
    "view plane.zarr --frame tool": "--frame is given, but plane.zarr is not a URDF",
    "export plane.zarr new.npz --window 0,0,1,1": "--window is given; export writes parts of tiled",
    # Texts of options
    f"{MAP} --rotations 0": "--rotations is '0'; it must be a count above zero",
    f"{MAP} --rotations 7.5": "--rotations is '7.5'",
    f"{MAP} --bounds here": "--bounds is 'here'",
    f"{MAP_CUBE} --bounds 0,0,0,1,-1,1": "must be above",
    f"{PLAN} --start 5": "--start is '5'; the map's configurations are x,y",
    f"{PLAN_TURNING} --start 1,1,90": "write 90deg for degrees",
    f"{PLOT} --rotation 1": "--rotation is '1'; the map has no rotations",
    # Outputs
    f"{MAP} -o new.xyz": "new.xyz ends in '.xyz'",
    f"{MAP} -o plane.zarr": "plane.zarr: exists; existing outputs are kept by default; pass --overwrite",
    f"{MAP} -o absent/new.zarr": "absent is not a folder",
    f"{MAP} -o precious --overwrite": "precious",
    f"{MAP} --tile 9 -o precious.zarr/m": "precious.zarr",
    f"{PLAN} -o a.csv -o ./a.csv": "name a file twice",
    "export plane.zarr old.yaml": "old.pgm: exists",
    "demo --output notes.txt": "folder",
    "demo --output notes.txt/demo": "folder",
    # Inputs
    "map absent.yaml --robot disc:1 -o new.zarr": "absent.yaml",
    "plan broken.zarr --start 0,0 --goal 1,1": "broken.zarr",
    f"{PLOT} --path notes.csv": "notes.csv: has no path",
    f"{PLOT} --path empty.csv": "empty.csv: has no configuration",
    f"{PLOT} --path list.json": "list.json: has no path",
    f"{PLOT} --path old.png": "old.png",
    f"{PLOT} --path swapped.csv": "swapped.csv: has y, x; the map's axes are x, y",
    f"{PLOT} --path wide.json": "wide.json: has an array (1, 5)",
    # Usage
    "fly": "No such command 'fly'; see ",
    "map": "Missing argument 'WORKSPACE'; see ",
    f"{MAP} --outside wet": "'wet'",
}
"""Parts of the messages of commands."""


@pytest.mark.parametrize("command", REFUSED_COMMANDS)
def test_invalid_input_is_refused_in_one_line(command, room):
    for name, text in FILES.items():
        Path(name).parent.mkdir(exist_ok=True)
        Path(name).write_text(text)
    before = sorted(room.rglob("*"))
    result = run(command)
    assert result.exit_code == 2, result.exception or result.output
    assert result.stdout == ""
    assert result.stderr.startswith("cspace: ") and result.stderr.count("\n") == 1
    assert REFUSED_COMMANDS[command] in result.stderr
    assert sorted(room.rglob("*")) == before


@pytest.mark.parametrize(
    "command",
    [f"{MAP} --rotations 0", f"{MAP} --bounds here", f"{MAP} -o plane.zarr", f"{PLAN} -o p.txt"],
)
def test_options_are_checked_before_any_work(room, monkeypatch, command):
    for function in ("_opening.open_map", "_workspace.Workspace.open"):
        monkeypatch.setattr(f"cspace.{function}", None)
    assert run(command).exit_code == 2


@pytest.mark.parametrize("command", [MAP, f"{PLAN} -o path.csv", "demo", "demo -o new/demo"])
def test_folders_without_permission_are_refused(room, monkeypatch, command):
    # os.access is patched, because the superuser may write everywhere.
    monkeypatch.setattr("os.access", lambda _, mode: not mode & os.W_OK)
    result = run(command)
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr and result.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "error, code, message",
    [
        (KeyboardInterrupt(), 130, "cspace: interrupted\n"),
        (MemoryError("cannot allocate"), 2, "cspace: out of memory: cannot allocate"),
        (OSError("No space left on device"), 2, "cspace: No space left on device\n"),
    ],
)
def test_interruptions_and_system_errors_end_in_one_line(room, monkeypatch, error, code, message):
    def fail(_):
        raise error

    monkeypatch.setattr("cspace._opening.open_map", fail)
    result = run("info plane.zarr")
    assert (result.exit_code, result.stdout) == (code, "")
    assert result.stderr.startswith(message) and result.stderr.count("\n") == 1


def test_defects_stay_visible(room, monkeypatch):
    monkeypatch.setattr("cspace._opening.open_map", lambda _: 1 / 0)
    assert isinstance(run("info plane.zarr").exception, ZeroDivisionError)
