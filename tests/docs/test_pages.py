"""Code in the README, the documentation and docstrings.

Pages run in separate folders. Blocks marked ``python`` and ``console`` run; blocks marked ``sh``
and ``py`` need a network or other machines.
"""

import contextlib
import doctest
import json
import re
import runpy
import shlex
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import zarr
from matplotlib import pyplot
from PIL import Image

import cspace
from cspace._cli.demo import write_inputs
from cspace.plot import animate
from cspace.plot._picture import save_figure
from planners import plan
from tests.helpers.commands import commands, run
from tests.helpers.repository import ROOT, SOURCES

CODE_BLOCK = re.compile(r"^```(python|console)\n(.*?)^```", re.DOTALL | re.MULTILINE)
PAGES = {
    str(page.relative_to(ROOT)): CODE_BLOCK.findall(page.read_text(encoding="utf-8"))
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
}
OWN_SESSION = "docs/howto/bring_your_file.md"
"""Page whose packages are large; `nox -s formats` runs its code."""
PAGES_WITH_CODE = [name for name, blocks in PAGES.items() if blocks and name != OWN_SESSION]
MODULES_WITH_EXAMPLES = [
    name for name, file in SOURCES.items() if ">>> " in file.read_text(encoding="utf-8")
]


def write_files(folder):
    """Write the inputs of pages."""
    (folder / "cspace-demo").mkdir()
    write_inputs(folder / "cspace-demo")
    pixels = np.full((120, 160), 254, np.uint8)
    pixels[[0, -1], :] = pixels[:, [0, -1]] = pixels[30:, 78:82] = 0
    Image.fromarray(pixels).save(folder / "room.pgm")
    lines = [
        "image: room.pgm",
        "mode: trinary",
        "resolution: 0.05",
        "origin: [-4.0, -3.0, 0.0]",
        "negate: 0",
    ]
    (folder / "room.yaml").write_text(
        "\n".join([*lines, "occupied_thresh: 0.65", "free_thresh: 0.196", ""])
    )
    write_lanes(folder / "lanes.geojson")
    write_arm(folder / "two.urdf")
    field = np.zeros((800, 600), dtype=bool)
    field[300:320, :400] = True
    zarr.create_array(folder / "occupied.zarr", data=field, config={"write_empty_chunks": True})


def write_lanes(file):
    """Write a Nav2 route graph of one edge."""
    ends = [[-3.0, -2.0], [-1.0, -2.0]]
    shapes = [("Point", ends[0]), ("Point", ends[1]), ("MultiLineString", [ends])]
    features = [
        {
            "type": "Feature",
            "properties": {"id": number, "startid": 0, "endid": 1},
            "geometry": {"type": kind, "coordinates": coordinates},
        }
        for number, (kind, coordinates) in enumerate(shapes)
    ]
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def write_arm(file):
    """Write the arm of two bars that the page on arms writes."""
    block = next(text for _, text in PAGES["docs/howto/arms.md"] if file.name in text)
    statements = block.partition("arm = ")[0]
    with contextlib.chdir(file.parent):
        exec(statements, {})


@pytest.mark.parametrize("page", PAGES_WITH_CODE)
def test_the_code_of_a_page_runs(page, tmp_path, monkeypatch):
    """Run the blocks of a page in one namespace and one folder, empty for cli.md.

    For speed, pictures are small and without layout, animations are short, and anytime planners
    have 0.1 s.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cspace.plot.animate", partial(animate, seconds=0.5))
    monkeypatch.setattr("cspace.plot._picture.save_figure", save_small)
    monkeypatch.setattr("planners.plan", plan_briefly)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: pyplot.close("all"))
    monkeypatch.setattr(
        "matplotlib.layout_engine.ConstrainedLayoutEngine.execute", lambda engine, figure: None
    )
    if page != "docs/reference/cli.md":
        write_files(tmp_path)
    names = {"__name__": "page"}
    for kind, text in PAGES[page]:
        if kind == "python":
            exec(compile(text, page, "exec"), names)
            continue
        for line in re.sub(r"\\\n", "", text).splitlines():
            for command in line.removeprefix("$ ").split(" && ") if line.startswith("$ ") else []:
                call(command, monkeypatch)


def save_small(draw, file, overwrite, dpi):
    def draw_without_layout():
        figure = draw()
        figure.set_layout_engine(None)  # otherwise it is draw_without_layout twice
        return figure

    return save_figure(draw_without_layout, file, overwrite=overwrite, dpi=30.0)


def plan_briefly(*arguments, **options):
    return plan(*arguments, **({"time_limit": 0.1} if "objective" in options else {}) | options)


def call(command, monkeypatch):
    program, *arguments = shlex.split(command)
    if program == "cd":
        monkeypatch.chdir(*arguments)
        return
    assert program == "cspace"
    result = run(*arguments)
    assert result.exit_code == 0, f"{command}: {result.stderr or result.exception}"
    for name in arguments:
        if name.endswith((".csv", ".png", ".gif", ".vti", ".zarr", ".yaml", ".json")):
            assert Path(name).exists(), f"{command} did not write {name}"


@pytest.mark.parametrize("page", PAGES)
def test_files_that_a_page_names_exist(page):
    text = re.sub(
        r"^```.*?^```",
        "",
        (ROOT / page).read_text(encoding="utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    named = re.findall(r"`((?:cspace|planners|tests|benchmarks|docs|examples)/[\w/.]+)`", text)
    linked = [
        link.partition("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if ":" not in link
    ]
    files = [ROOT / name for name in named] + [
        (ROOT / page).parent / link for link in linked if link
    ]
    assert [str(file) for file in files if not file.exists()] == []


def list_commands(file):
    """List the commands in the text of a page, or in the comments of a tutorial, as words."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        text = re.sub(r"\n *# ?", "\n", text)
    inline = re.findall(r"`(cspace [a-z][^`]*)`", text)
    lines = re.findall(r"^(?:\$ )?(cspace [a-z].*)", re.sub(r"\\\n", "", text), re.MULTILINE)
    parts = [part for each in inline + lines for part in re.split(r" (?:&&|\||#) ", each)]
    return [shlex.split(part)[1:] for part in parts if part.startswith("cspace ")]


def test_commands_in_the_text_of_pages_have_the_options_that_they_need():
    files = [ROOT / page for page in PAGES if page != "docs/reference/old_names.md"]
    files += [file for folder in ("tutorials", "examples") for file in (ROOT / folder).glob("*.py")]
    found = [words for file in files for words in list_commands(file)]
    assert len(found) > 30
    for name, *arguments in found:
        command = commands()[name]
        if arguments and "..." not in arguments:  # otherwise only a part of it is shown
            command.make_context(name, arguments)
        options = {text for each in command.params for text in (*each.opts, *each.secondary_opts)}
        named = {word.partition("=")[0] for word in arguments if word.startswith("--")}
        assert named <= options | {"--help"}, (name, arguments)


@pytest.mark.parametrize("page", PAGES)
def test_tests_that_a_page_selects_exist(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for file, word in re.findall(r"(tests/[\w/]+\.py) -k (\w+)", text):
        tests = re.findall(r"^def (test_\w+)", (ROOT / file).read_text("utf-8"), re.MULTILINE)
        assert any(word in name for name in tests), f"-k {word} selects no test of {file}"


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_a_picture_once(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    links = re.findall(r"!\[[^]]*\]\(([^)\s]+)\)", text)
    assert len(set(links)) == len(links)


def test_pictures_of_pages_differ():
    files = [file for suffix in ("png", "gif") for file in (ROOT / "docs").glob(f"**/*.{suffix}")]
    files = [file for file in files if "_build" not in file.parts]
    contents = {file.read_bytes() for file in files}
    assert len(contents) == len(files) > 10


def test_a_tutorial_shows_a_figure_once(tmp_path, monkeypatch):
    """A figure that is saved and stays open is shown as its file alone."""
    pytest.importorskip("sphinx_gallery")
    names = runpy.run_path(str(ROOT / "docs" / "conf.py"))
    scrapers = names["sphinx_gallery_conf"]["image_scrapers"]
    monkeypatch.chdir(tmp_path)
    figure, axes = pyplot.subplots()
    (tmp_path / "pages").mkdir()
    paths = (str(tmp_path / "pages" / f"{number}.png") for number in range(9))
    page = {"image_path_iterator": paths, "src_file": "a.py"}
    gallery = {"src_dir": str(tmp_path)}
    for number in range(2):
        axes.plot([0, number])
        figure.savefig(f"{number}.png")
        for scraper in scrapers:
            scraper((), page, gallery)
        assert len(list((tmp_path / "pages").iterdir())) == number + 1
    figure.savefig("again.png")
    with pytest.raises(ValueError, match=r"again\.png is a picture that the page shows above"):
        scrapers[0]((), page, gallery)
    pyplot.close(figure)


def test_the_pictures_of_concepts_can_be_drawn(tmp_path):
    names = runpy.run_path(str(ROOT / "docs" / "pictures" / "draw.py"))
    names["draw_all"](tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        file.name for file in (ROOT / "docs" / "pictures").glob("*.[pg][ni][gf]")
    }


@pytest.mark.parametrize("module", MODULES_WITH_EXAMPLES)
def test_the_examples_of_docstrings_run(module, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    failed, tried = doctest.testmod(import_module(module))
    assert tried
    assert not failed


def write_map(folder, pixels, **changed):
    """Write a ROS map of cells of 0.05 m, whose image has rows from the top."""
    Image.fromarray(pixels.astype(np.uint8)).save(folder / "room.pgm")
    fields = {"image": "room.pgm", "resolution": 0.05, "origin": [-4.0, -3.0, 0.0], "negate": 0}
    fields |= {"occupied_thresh": 0.65, "free_thresh": 0.196} | changed
    (folder / "room.yaml").write_text(json.dumps(fields))


ROOM = np.full((120, 160), 254)
ROOM[[0, -1], :] = ROOM[:, [0, -1]] = ROOM[30:, 78:82] = 0
"""A room of 8 m by 6 m, with a wall that leaves 1.5 m at the top."""


@pytest.mark.parametrize(
    "pixels, changed, found",
    [
        (ROOM, {}, True),
        (254 - ROOM, {"negate": 1}, True),
        (ROOM, {"mode": "scale"}, True),
        # The image turns about the origin, its lower left corner.
        (ROOM, {"origin": [-4.0, 3.0, -np.pi / 2]}, False),
        (np.where(np.arange(120)[:, None] < 30, 205, ROOM), {}, False),  # unknown above the wall
        (np.where(np.arange(120)[:, None] < 30, 0, ROOM), {}, False),
    ],
)
def test_a_plan_on_a_ros_map_heeds_what_the_map_says(pixels, changed, found, tmp_path):
    write_map(tmp_path, pixels, **changed)
    read = runpy.run_module("examples.readers.map_of_yaml")["plan_on_map"]
    if found:
        path = read(str(tmp_path / "room.yaml"), (-3.0, -2.0), (3.0, -2.0))
        assert path.certified and path.path[:, 1].max() > 1.6
    else:
        with pytest.raises((SystemExit, cspace.InputError)):
            read(str(tmp_path / "room.yaml"), (-3.0, -2.0), (3.0, -2.0))
