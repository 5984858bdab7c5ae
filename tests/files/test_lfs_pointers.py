"""Pointers of git-lfs in place of files."""

import inspect

import pytest

from cspace import Arm, FileError, Robot, Workspace
from cspace.files.formats import ROBOT_FORMATS, WORKSPACE_FORMATS
from tests.helpers.urdfs import joint, link, write_urdf

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:" + 64 * "0" + "\nsize 12345\n"


def open_workspace(path):
    parameters = inspect.signature(
        getattr(Workspace, WORKSPACE_FORMATS[path.suffix].method)
    ).parameters
    return Workspace.open(path, **({"spacing": 0.1} if "spacing" in parameters else {}))


READERS = {
    **{f"workspace{suffix}": open_workspace for suffix in WORKSPACE_FORMATS if suffix != ".zarr"},
    **{f"robot{suffix}": Robot.open for suffix in ROBOT_FORMATS},
    "arm.urdf": Arm.from_urdf,
}


@pytest.mark.parametrize("name", READERS)
def test_pointers_are_refused_with_the_command_that_fetches_the_file(tmp_path, name):
    path = tmp_path / name
    path.write_text(POINTER)
    with pytest.raises(
        FileError, match=rf"{name}: is a git-lfs pointer; .* has not been fetched; run git lfs pull"
    ):
        READERS[name](path)


def test_a_pointer_named_by_a_urdf_is_refused(tmp_path):
    (tmp_path / "part.stl").write_text(POINTER)
    mesh = '<collision><geometry><mesh filename="part.stl"/></geometry></collision>'
    urdf = write_urdf(
        tmp_path, link("a", ((1, 1, 1), (0, 0, 0))), link("b", extra=mesh), joint("j", "a", "b")
    )
    with pytest.raises(FileError, match=r"part.stl: is a git-lfs pointer"):
        Arm.from_urdf(urdf)
    with pytest.raises(FileError, match=r"part.stl: is a git-lfs pointer"):
        Robot.from_urdf(urdf, "b")
