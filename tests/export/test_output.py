"""Outputs, complete or absent."""

import os
from pathlib import Path

import pytest

from cspace._files.access import replacing
from cspace.errors import FileError, InputError


def write(path, text, *, overwrite=False):
    with replacing(path, overwrite) as temporary:
        temporary.write_text(text)


def write_folder(path, text, *, overwrite=False):
    with replacing(path, overwrite, folder=lambda old: (old / "text").exists()) as temporary:
        temporary.mkdir()
        (temporary / "text").write_text(text)


WRITERS = pytest.mark.parametrize("writer", [write, write_folder])


def list_names(folder):
    return sorted(entry.name for entry in folder.iterdir())


def read(path):
    """Return the text of a file, or of the file in a folder."""
    return (path / "text" if path.is_dir() else path).read_text()


@WRITERS
def test_an_existing_output_is_kept_without_overwrite(tmp_path, writer):
    path = tmp_path / "out.npz"
    writer(path, "old")
    with pytest.raises(FileError, match=r"npz: exists; existing outputs are kept .*overwrite=True"):
        writer(path, "new")
    assert read(path) == "old"
    writer(path, "new", overwrite=True)
    assert read(path) == "new"
    assert list_names(tmp_path) == ["out.npz"]


@WRITERS
@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_an_interruption_leaves_the_old_output(
    tmp_path,
    monkeypatch,
    writer,
    stop,
):
    writer(tmp_path / "out", "old")

    def interrupt(path, *_):
        assert path.exists() or path.parent.exists()
        raise stop

    monkeypatch.setattr(Path, "write_text", interrupt)
    for name in ("out", "other"):
        with pytest.raises(stop):
            writer(tmp_path / name, "new", overwrite=True)
    assert list_names(tmp_path) == ["out"]
    assert read(tmp_path / "out") == "old"


def test_an_existing_target_is_refused_before_and_after_the_work(tmp_path):
    with pytest.raises(FileError, match="exists"), replacing(tmp_path / "out") as temporary:
        assert (temporary.parent, temporary.suffix) == (tmp_path, "")
        temporary.write_text("mine")
        (tmp_path / "out").write_text("theirs")
    assert read(tmp_path / "out") == "theirs"
    with pytest.raises(FileError, match="exists"), replacing(tmp_path / "out"):
        pytest.fail("the work began")
    assert list_names(tmp_path) == ["out"]


@pytest.mark.parametrize("failing, remaining", [(1, "old"), (2, "old"), (3, "old"), (4, "new")])
@pytest.mark.parametrize("stop", [OSError("no"), KeyboardInterrupt()])
def test_a_failed_rename_leaves_the_old_or_the_new_folder(
    tmp_path,
    monkeypatch,
    failing,
    remaining,
    stop,
):
    """Interrupt the vain rename, the other two, and the moment after."""
    path = tmp_path / "map"
    write_folder(path, "old")
    rename = os.rename
    calls = 0

    def stub(source, target):
        nonlocal calls
        calls += 1
        if calls == failing:
            raise stop
        rename(source, target)
        if calls == 3 < failing:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "rename", stub)
    is_named = isinstance(stop, OSError) and failing < 4
    with pytest.raises(FileError if is_named else KeyboardInterrupt):
        write_folder(path, "new", overwrite=True)
    assert calls >= min(failing, 3)
    assert list_names(tmp_path) == ["map"]
    assert read(path) == remaining


@pytest.mark.parametrize(
    "writer, name, message",
    [
        (write_folder, "home", "holds more than an earlier output"),
        (write_folder, "file", "not a folder"),
        (write, "home", "not a plain file"),
        (write, "pipe", "not a plain file"),
        (write, "nowhere/out", "nowhere is not a folder"),
    ],
)
def test_only_an_earlier_output_is_replaced(tmp_path, writer, name, message):
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / "thesis.tex").write_text("years")
    (tmp_path / "file").write_text("old")
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(FileError, match=message):
        writer(tmp_path / name, "new", overwrite=True)
    assert list_names(tmp_path) == ["file", "home", "pipe"]
    assert list_names(tmp_path / "home") == ["thesis.tex"]
    assert read(tmp_path / "file") == "old"


def test_empty_folders_are_replaced_and_links_followed(tmp_path):
    (tmp_path / "map").mkdir()
    write_folder(tmp_path / "map", "new", overwrite=True)
    assert list_names(tmp_path / "map") == ["text"]
    (tmp_path / "link").symlink_to(tmp_path / "out")
    write(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert read(tmp_path / "out") == "new"
    (tmp_path / "plain").write_text("new")
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_errors_of_the_system_are_named(tmp_path, monkeypatch):
    path = tmp_path / "out"
    with pytest.raises(FileError, match="out: cannot be written: No space"), replacing(path):
        raise OSError(28, "No space left on device")
    with pytest.raises(FileError, match="cannot be written"), replacing(path):
        pass  # nothing was written
    with pytest.raises(FileError, match=r"^mine$"), replacing(path):
        raise FileError("mine")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileError, match=r"no permission to write in .*; outputs need a writable"):
        write(path, "new")
    assert list_names(tmp_path) == []


@pytest.mark.parametrize("path", ["x" * 400, "nul\0byte", "", None])
def test_impossible_names_are_refused(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises((FileError, InputError)):
        write(path, "new")  # type: ignore[arg-type]
    assert list_names(tmp_path) == []


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("at_call", [1, 2, 3])
def test_writers_of_one_folder_at_once_leave_one_output(tmp_path, monkeypatch, overwrite, at_call):
    """Run a second writer before a rename of the first."""
    path = tmp_path / "map"
    if overwrite:
        write_folder(path, "old")
    rename = os.rename
    calls = 0

    def stub(source, target):
        nonlocal calls
        calls += 1
        if calls == at_call:
            write_folder(path, "second", overwrite=overwrite)
        rename(source, target)

    monkeypatch.setattr(os, "rename", stub)
    if not overwrite and at_call == 1:
        with pytest.raises(FileError, match="exists"):
            write_folder(path, "first")
        assert read(path) == "second"
    else:
        write_folder(path, "first", overwrite=overwrite)
        assert read(path) == "first"
    assert list_names(tmp_path) == ["map"]
