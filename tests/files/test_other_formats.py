"""Refusals of formats that another program converts."""

from collections.abc import Callable
from pathlib import Path

import pytest

from cspace import CspaceError, Mesh, Robot, Workspace

OPENERS: dict[str, Callable[[Path], object]] = {
    "workspace": lambda path: Workspace.open(path, spacing=0.1),
    "mesh": Mesh.of,
    "robot": Robot.open,
    "shape of a robot": lambda path: Robot("cart", path),
}


@pytest.mark.parametrize("opener", OPENERS)
@pytest.mark.parametrize(
    ("name", "converter"),
    [
        ("mesh.off", "trimesh.load('mesh.off').export('mesh.ply')"),
        ("LABELS.NRRD", "pynrrd or SimpleITK"),
    ],
)
def test_a_file_of_another_format_is_refused_with_its_converter(
    tmp_path: Path, name: str, converter: str, opener: str
) -> None:
    path = tmp_path / name
    path.touch()
    with pytest.raises(CspaceError) as refused:
        OPENERS[opener](path)
    assert converter in refused.value.hint


def test_a_missing_file_of_another_format_needs_no_converter(tmp_path: Path) -> None:
    with pytest.raises(CspaceError) as refused:
        Workspace.open(tmp_path / "mesh.off", spacing=0.1)
    assert "trimesh" not in refused.value.hint
