"""How Sphinx builds the documentation and runs the examples: ``sphinx-build -W --keep-going docs
docs/_build``."""

import re
import runpy
import shutil
import warnings
from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst
from sphinx_gallery.sorting import FunctionSortKey

import cspace

project = "cspace"
author = "The cspace developers"
copyright = "The cspace developers"  # noqa: A001 - Sphinx asks for this name
version = release = cspace.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "**/GALLERY_HEADER.rst"]
templates_path = ["_templates"]
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
autodoc_typehints = "none"  # docstrings tell types, with shapes and units
autodoc_member_order = "groupwise"
numpydoc_show_class_members = False
toc_object_entries_show_parents = "hide"

nitpicky = True
nitpick_ignore_regex = [
    ("py:attr", ".*"),  # the page of a record describes its fields, which are no targets
    ("py:.*", r"cspace\.ros\..*"),  # the API shows these by their module, cspace._files.ros_maps
]
suppress_warnings = ["config.cache"]  # the two functions below are not kept between builds

html_theme = "pydata_sphinx_theme"
html_title = "cspace"
html_static_path = ["_static"]
html_css_files = ["cspace.css"]
html_show_sourcelink = False
html_sidebars = {"install": []}
html_theme_options = {
    "show_nav_level": 1,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "navigation_with_keys": False,
}


def written_pictures(block: Any, names: dict[str, Any], gallery: dict[str, Any]) -> str:
    """Show the pictures that an example wrote into its folder; examples run in their folder.

    Figures that stay open are not shown, because they would appear a second time. Raises ValueError
    if a page shows one picture twice.
    """
    taken = []
    shown = names.setdefault("shown_pictures", set())
    for file in sorted(Path().glob("*.[pg][ni][gf]"), key=lambda file: file.stat().st_mtime_ns):
        target = Path(next(names["image_path_iterator"])).with_suffix(file.suffix)
        content = file.read_bytes()
        if content in shown:
            raise ValueError(f"{names['src_file']}: {file} is a picture that the page shows above")
        shown.add(content)
        shutil.move(file, target)
        taken.append(str(target))
    return figure_rst(taken, gallery["src_dir"])


def strict(gallery: dict[str, Any], name: str, when: str) -> None:
    """Let an example fail if it warns."""
    if when == "before":
        warnings.simplefilter("error")
    else:
        warnings.filters.remove(("error", None, Warning, None, 0))


ORDER = (
    "mobile_robots cars drones arms fleets controllers research "
    "ros_map ros_messages sources robots doors warehouse_robot parking moving_obstacles replan_at_speed wait_for_others speed_zones under_racks roadmap corridor_proof why_not "
    "drone_building drone_slit window_proof drawn_out packing best_placements z_tunnel large_map "
    "arm_line waiter pull_arm porter gate compare_planners keep_away bare_ompl report_figures"
)
"""Order of tutorials and examples; other scripts come last."""


def place(file: str) -> int:
    """Return the position of a script in that order."""
    return f"{ORDER} {Path(file).stem}".split().index(Path(file).stem)


sphinx_gallery_conf = {
    "examples_dirs": ["../tutorials", "../examples"],
    "gallery_dirs": ["tutorials", "gallery"],
    "copyfile_regex": "",
    "capture_repr": (),
    "within_subsection_order": FunctionSortKey(place),
    "filename_pattern": r"\.py$",
    "image_scrapers": (written_pictures,),
    "reset_modules": ("matplotlib", strict),
    "reset_modules_order": "both",
    "doc_module": ("cspace", "planners"),
    "backreferences_dir": "gallery/uses",
    "inspect_global_variables": True,
    "min_reported_time": 1,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
    "remove_config_comments": True,
    "plot_gallery": "True",
    "abort_on_example_error": False,
}


ROOT_PAGES = "SECURITY|CHANGELOG|CONTRIBUTING"
"""Pages in the root of the repository that a page of the site includes."""


def at_home(app: Any, page: str, source: list[str]) -> None:
    """Turn links to files outside this folder, which work on GitHub, into links to pages of the
    site."""
    up = "../" * page.count("/")
    source[0] = re.sub(r"\]\((?:\.\./)+examples/(\w+)\.py\)", rf"]({up}gallery/\1.rst)", source[0])
    source[0] = re.sub(
        r"\]\((?:\.\./)+tutorials/(\w+)\.py\)", rf"]({up}tutorials/\1.rst)", source[0]
    )
    source[0] = re.sub(
        rf"\]\((?:\.\./)+({ROOT_PAGES})\.md(#[\w-]+)?\)",
        lambda m: f"]({up}{m[1].lower()}.md{m[2] or ''})",
        source[0],
    )


LISTS = runpy.run_path(str(Path(__file__).parent / "lists.py"))


def label(
    app: Any, what: str, name: str, documented: object, options: object, lines: list[str]
) -> None:
    """Say below the first sentence of a name that it is experimental, if it is."""
    if what in ("class", "function") and LISTS["is_experimental"](documented.__module__):
        end = lines.index("") if "" in lines else len(lines)
        lines[end:end] = ["", LISTS["EXPERIMENTAL"]]


def setup(app: Any) -> None:
    app.connect("source-read", at_home)
    app.connect("autodoc-process-docstring", label)
