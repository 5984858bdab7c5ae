"""Outputs, complete or absent."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from cspace.errors import FileError, InputError
from cspace.files.access import replacing

FOLDERS = pytest.mark.parametrize("folder", [False, True])
STOPS = [KeyboardInterrupt, ValueError, MemoryError, SystemExit]


def write(path: Path, text: str, *, overwrite: bool = False) -> None:
    with replacing(path, overwrite) as temporary:
        temporary.write_text(text)


def write_folder(path: Path, text: str, *, overwrite: bool = False) -> None:
    with replacing(path, overwrite, folder=lambda old: (old / "text").exists()) as temporary:
        temporary.mkdir()
        (temporary / "text").write_text(text)


def names(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def fill(path: Path, text: str, folder: bool) -> Path:
    """Write a file, or a folder with a file."""
    if folder:
        path.mkdir()
        path /= "text"
    path.write_text(text)
    return path


@FOLDERS
def test_an_output_appears_when_it_is_complete(tmp_path: Path, folder: bool) -> None:
    path = tmp_path / "map.npz"
    with replacing(path, folder=(lambda _: True) if folder else None) as temporary:
        fill(temporary, "new", folder)
        assert temporary.parent == tmp_path and temporary.suffix == ".npz" and not path.exists()
    assert names(tmp_path) == ["map.npz"]
    assert (path / "text" if folder else path).read_text() == "new"


@FOLDERS
@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("old", [False, True])
def test_an_interruption_leaves_the_old_output(
    tmp_path: Path, folder: bool, stop: type[BaseException], old: bool
) -> None:
    path = tmp_path / "out"
    file = fill(path, "old", folder) if old else path
    known = (lambda _: True) if folder else None
    with pytest.raises(stop), replacing(path, overwrite=True, folder=known) as temporary:
        fill(temporary, "half", folder)
        raise stop
    assert names(tmp_path) == (["out"] if old else [])
    assert not old or file.read_text() == "old"


@pytest.mark.parametrize("writer", [write, write_folder])
def test_an_existing_output_is_kept_without_overwrite(
    tmp_path: Path, writer: Callable[..., None]
) -> None:
    path = tmp_path / "out"
    writer(path, "old")
    with pytest.raises(FileError, match=r"out: exists; existing outputs are kept .*overwrite=True"):
        writer(path, "new")
    written = path / "text" if path.is_dir() else path
    assert written.read_text() == "old"
    writer(path, "new", overwrite=True)
    assert written.read_text() == "new"
    assert names(tmp_path) == ["out"]


def test_the_check_comes_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("old")
    ran = False
    with pytest.raises(FileError), replacing(tmp_path / "out"):
        ran = True
    assert not ran


def test_an_output_of_another_process_is_kept(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="exists"), replacing(tmp_path / "out") as temporary:
        temporary.write_text("mine")
        (tmp_path / "out").write_text("theirs")
    assert (tmp_path / "out").read_text() == "theirs"
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize(("failing", "remaining"), [(1, "old"), (2, "old"), (3, "new")])
@pytest.mark.parametrize("stop", [OSError("no"), KeyboardInterrupt()])
def test_a_failed_rename_leaves_the_old_or_the_new_folder(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    failing: int,
    remaining: str,
    stop: BaseException,
) -> None:
    """Interrupt both renames, and the moment after."""
    path = tmp_path / "map"
    write_folder(path, "old")
    rename, calls = os.rename, 0

    def stub(source: Path, target: Path) -> None:
        nonlocal calls
        calls += 1
        if calls == failing:
            raise stop
        rename(source, target)
        if calls == 2 < failing:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "rename", stub)
    with pytest.raises(
        FileError if isinstance(stop, OSError) and failing < 3 else KeyboardInterrupt
    ):
        write_folder(path, "new", overwrite=True)
    assert calls >= min(failing, 2)
    assert names(tmp_path) == ["map"]
    assert (path / "text").read_text() == remaining


@pytest.mark.parametrize(
    ("writer", "name", "message"),
    [
        (write_folder, "home", "holds more than an earlier output"),
        (write_folder, "file", "not a folder"),
        (write, "home", "not a plain file"),
        (write, "pipe", "not a plain file"),
        (write, "nowhere/out", r"nowhere is not a folder; .*create it first"),
        (write, "file/out", "file is not a folder"),
    ],
)
def test_only_an_earlier_output_is_replaced(
    tmp_path: Path, writer: Callable[..., None], name: str, message: str
) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years")
    (tmp_path / "file").write_text("old")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileError, match=message):
        writer(tmp_path / name, "new", overwrite=True)
    assert names(tmp_path) == ["file", "home", "pipe"] and names(tmp_path / "home") == [
        "thesis.tex"
    ]
    assert (tmp_path / "file").read_text() == "old" and (tmp_path / "pipe").is_fifo()


def test_an_empty_folder_may_be_replaced(tmp_path: Path) -> None:
    (tmp_path / "map").mkdir()
    write_folder(tmp_path / "map", "new", overwrite=True)
    assert names(tmp_path / "map") == ["text"]


def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "out").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real" / "out")
    write(tmp_path / "link", "new", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "out").read_text() == "new"


def test_an_unwritable_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(
        FileError, match=r"no permission to write in .*; outputs need a writable folder"
    ):
        write(tmp_path / "out", "new")
    assert names(tmp_path) == []


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind the superuser")
def test_permissions_are_respected(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(FileError, match="no permission to write in"):
        write(tmp_path / "out", "new")


def test_a_full_disk_is_named(tmp_path: Path) -> None:
    with (
        pytest.raises(FileError, match=r"out: cannot be written: No space left .*; outputs need"),
        replacing(tmp_path / "out") as temporary,
    ):
        temporary.write_text("half")
        raise OSError(28, "No space left on device")
    assert names(tmp_path) == []


def test_an_error_in_the_block_keeps_its_message(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"^mine$"), replacing(tmp_path / "out"):
        raise FileError("mine")


@pytest.mark.parametrize("path", ["x" * 400, "nul\0byte", "", None, 3])
def test_impossible_names_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: object
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        (FileError, InputError), match=None if isinstance(path, str) else "it must be a file name"
    ):
        write(path, "new")  # type: ignore[arg-type]
    assert names(tmp_path) == []


def test_nested_outputs_appear_together_or_not_at_all(tmp_path: Path) -> None:
    with (
        pytest.raises(KeyboardInterrupt),
        replacing(tmp_path / "a.yaml") as first,
        replacing(tmp_path / "a.pgm") as second,
    ):
        first.write_text("1")
        second.write_text("2")
        raise KeyboardInterrupt
    assert names(tmp_path) == []


def test_the_usual_permissions_apply(tmp_path: Path) -> None:
    write(tmp_path / "out", "new")
    (tmp_path / "plain").write_text("new")
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_writer_that_writes_nothing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot be written"), replacing(tmp_path / "out"):
        pass
    with (
        pytest.raises(FileError, match="cannot be written"),
        replacing(tmp_path / "out") as temporary,
    ):
        temporary.mkdir()
        shutil.rmtree(temporary)
