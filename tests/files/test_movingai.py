"""MovingAI maps."""

from pathlib import Path

import numpy as np
import pytest

from cspace import Grid, Workspace
from cspace.errors import FileError
from cspace.files.images import read_movingai_map
from tests.helpers.refusals import refusals

MAPS = ["AR0011SR", "Berlin_1_1024", "arena", "brc504d", "maze512-32-0", "random512-10-0"]

TINY_MAP = "type octile\nheight 2\nwidth 3\nmap\n.GS\n@.W\n"


def test_a_tiny_map_is_read(tmp_path: Path) -> None:
    path = tmp_path / "tiny.map"
    path.write_text(TINY_MAP)
    workspace = Workspace.from_movingai(path, 0.5)
    assert workspace.grid == Grid((0.0, 0.0), 0.5, (3, 2))
    assert workspace.outer.tolist() == [[True, False], [False, False], [True, False]]
    assert workspace.inner is workspace.outer
    assert workspace.source == str(path)


def test_every_letter_has_its_meaning(tmp_path: Path) -> None:
    (tmp_path / "all.map").write_text("type octile\nwidth 7\nheight 1\nmap\n.GS@OTW")
    assert read_movingai_map(tmp_path / "all.map").tolist() == [[False]] * 3 + [[True]] * 4


def test_windows_line_ends_are_read(tmp_path: Path) -> None:
    (tmp_path / "tiny.map").write_bytes(TINY_MAP.replace("\n", "\r\n").encode() + b"\r\n\r\n")
    assert read_movingai_map(tmp_path / "tiny.map").sum() == 2


@refusals(
    "text, message",
    ("", r"begins with \[''\]"),
    ("type tile\nheight 1\nwidth 1\nmap\n.", "begins with .'type tile'"),
    ("type octile", "begins with"),
    ("type octile\nheight two\nwidth 1\nmap\n.", "begins with .*'height two'"),
    ("type octile\nheight 0\nwidth 1\nmap\n.", "H and W above 0"),
    ("type octile\nheight " + "9" * 5000 + "\nwidth 1\nmap\n.", "'height 999"),
    ("type octile\nheight -1\nwidth 1\nmap\n.", "'height -1'"),
    ("type octile\nheight 1\nheight 1\nmap\n.", "'height H', 'width W'"),
    ("type octile\nheight 1\nwidth 1\n.", "begins with"),
    ("type octile\nheight 1\nwidth 1", "begins with"),
    ("type octile\nheight 2\nwidth 3\nmap\n...\n..", r"2 rows of \[2, 3\] .* 2 rows of 3"),
    ("type octile\nheight 2\nwidth 3\nmap\n...\n....", r"2 rows of \[3, 4\]"),
    ("type octile\nheight 2\nwidth 3\nmap\n...", "1 rows of .* says 2 rows of 3"),
    ("type octile\nheight 1\nwidth 3\nmap\n...\n...", "2 rows of .* says 1 rows of 3"),
    ("type octile\nheight 2\nwidth 3\nmap\n...\n.x.", "line 6, column 2 is 'x'"),
    ("type octile\nheight 2\nwidth 3\nmap\n...\n. .", "line 6, column 2 is ' '"),
)
def test_malformed_maps_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "bad.map").write_text(text)
    with pytest.raises(FileError, match=message):
        read_movingai_map(tmp_path / "bad.map")


def test_a_map_that_is_not_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.map").write_bytes(b"type octile\n\xff\xfe")
    with pytest.raises(FileError, match="byte 12 is not UTF-8"):
        read_movingai_map(tmp_path / "bad.map")


@pytest.mark.parametrize("name", MAPS)
def test_real_maps_agree_with_a_plain_reading(data: Path, name: str) -> None:
    path = data / "movingai" / f"{name}.map"
    lines = path.read_text().splitlines()
    height, width, rows = int(lines[1].split()[1]), int(lines[2].split()[1]), lines[4:]
    workspace = Workspace.from_movingai(path)
    assert workspace.grid == Grid((0.0, 0.0), 1.0, (width, height))
    assert workspace.outer.sum() == sum(row.count(letter) for row in rows for letter in "@OTW")
    for x, y in np.random.default_rng(0).integers((width, height), size=(500, 2)).tolist():
        assert workspace.outer[x, y] == (rows[height - 1 - y][x] in "@OTW")
