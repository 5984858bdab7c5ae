"""Pictures refuse invalid arguments, and replace no file unasked."""

import pytest
from matplotlib.figure import Figure

from cspace import FileError, InputError
from cspace.plot import animate, plot, save_plot
from tests.helpers.pictures import TURNING_PATH
from tests.helpers.refusals import refusals


@pytest.fixture(scope="module")
def maps(flat, turning, hall):
    return {"flat": flat, "turning": turning, "hall": hall}


def check_refusal(folder, message, draw, *arguments, **options):
    """Fail unless a call raises InputError with a message and writes no file."""
    with pytest.raises(InputError) as caught:
        draw(*arguments, **options)
    assert message in str(caught.value)
    assert list(folder.iterdir()) == []


@refusals(
    "name, options, message",
    ("flat", {"path": [(1.0, 2.0, 3.0)]}, "path has shape (1, 3); it must be (n, 2); pass (x, y)"),
    ("flat", {"rotation": 0.5}, "rotation has shape (1,); the robot does not turn"),
    ("flat", {"center": (1, 1)}, "center is given without zoom"),
    ("flat", {"zoom": 2.0, "center": (9.0, 1.0)}, "center is [9.0, 1.0]; the grid is from"),
    ("flat", {"cut": 1.0}, "cut is given with view plane; it needs view 3d"),
    ("flat", {"file": "map.xyz"}, "use one of .png, .pdf, .svg, .jpg"),
    ("turning", {"rotation": [0.0, 1.0]}, "rotation has shape (2,); a rotation is given by yaw"),
    (
        "hall",
        {"view": "3d", "camera": (30, 120, 3)},
        "camera is (30, 120, 3); it must be (elevation",
    ),
)
def test_save_plot_refuses_invalid_options(maps, tmp_path, name, options, message):
    options = dict(options)
    file = tmp_path / options.pop("file", "map.png")
    check_refusal(tmp_path, message, save_plot, maps[name], file, **options)


def test_plot_refuses_axes_of_another_kind(flat, hall):
    with pytest.raises(InputError, match=r"ax is a str; it must be matplotlib axes"):
        plot(flat, ax="x")
    with pytest.raises(InputError, match="ax has two dimensions"):
        plot(hall, ax=Figure().add_subplot(), view="3d")


@refusals(
    "path, options, message",
    ([(1, 1)], {}, "path has shape (1, 2); it must be (n, 3)"),
    (TURNING_PATH, {"seconds": 0}, "seconds is 0"),
    (TURNING_PATH, {"file": "drive.mp4"}, ".gif"),
    (TURNING_PATH, {"camera": (30, 30)}, "camera is given for a plane map"),
)
def test_animate_refuses_invalid_options(turning, tmp_path, path, options, message):
    options = dict(options)
    file = tmp_path / options.pop("file", "drive.gif")
    check_refusal(tmp_path, message, animate, turning, path, file, **options)


@pytest.mark.parametrize(
    "suffix, begin",
    [(".png", b"\x89PNG"), (".pdf", b"%PDF"), (".svg", b"<?xml"), (".jpg", b"\xff\xd8")],
)
def test_pictures_replace_no_file_unasked_and_make_no_folder(flat, tmp_path, suffix, begin):
    file = tmp_path / f"map{suffix}"
    file.write_text("precious")
    with pytest.raises(FileError, match="exists"):
        save_plot(flat, file)
    assert file.read_text() == "precious"
    save_plot(flat, file, overwrite=True)
    assert file.read_bytes().startswith(begin)
    assert [entry.name for entry in tmp_path.iterdir()] == [file.name]
    with pytest.raises(FileError, match="folder"):
        save_plot(flat, tmp_path / "absent" / file.name)
