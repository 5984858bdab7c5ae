"""How Sphinx builds the documentation and runs the examples: ``sphinx-build -W --keep-going docs
docs/_build``."""

import inspect
import re
import shutil
import warnings
from functools import reduce
from importlib import import_module
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
FOR_PLANNERS = (
    "check_bounds, check_endpoint, clearance_along, dim, distance_unit, drawable, find_goals, "
    "has_cells, has_poses, in_memory, is_labelled, length_unit, max_velocity, "
    "obstacle_distance_along, path_exists, resolution, search, searches, steps_between, subproblems"
)
"""What planners ask of maps and arms; the page of Space describes it."""

autosummary_context = {
    "inside": {
        **dict.fromkeys(("CSpace", "TiledCSpace", "ArmSpace"), FOR_PLANNERS),
        "Arm": "branch_to, check_configuration, check_configurations, check_limits, clamp, "
        "contact_samples, moving_pairs, ranges, rest, solve_pose, whole_turns",
        "PlanningScene": "place",
        "Mesh": "cells, check_origin, is_same, measure, rasters",
        "Rotations": "COORDINATES, KINDS, about_z, add_steps, all_limits, all_names, all_units, angles_to_centers, "
        "assign_slices, canonical_rotation, check_dimension, check_rotation, describe, draw_cells, "
        "examples, facts, find_cells, find_cells_within, find_images, find_one_cell, find_yaw, format_rotation, "
        "from_matrix, from_stored_arrays, leading_axes, limits, make_canonical, make_lookups, "
        "make_matrices, make_shape_cells, neighbors, of_stored_arrays, of_value, only_rotation, preserve, rotate, "
        "rotation_between, rotation_matrices, sample, sample_near, slack, split_configurations, steps_between, "
        "stored_arrays, volumes",
    }
}
"""Methods for the two packages only, by class; the API pages omit them."""
toc_object_entries_show_parents = "hide"

nitpicky = True
nitpick_ignore_regex = [
    ("py:attr", ".*")
]  # the page of a record describes its fields, which are no targets
suppress_warnings = ["config.cache"]  # the two functions below are not kept between builds

html_theme = "pydata_sphinx_theme"
html_title = "cspace"
html_static_path = ["_static"]
html_css_files = ["cspace.css"]
html_show_sourcelink = False
html_sidebars = {"install": []}
html_theme_options = {
    "show_nav_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "navigation_with_keys": False,
}


def written_pictures(block: Any, names: dict[str, Any], gallery: dict[str, Any]) -> str:
    """Show the pictures that an example wrote into its folder; examples run in their folder."""
    taken = []
    for file in sorted(Path().glob("*.[pg][ni][gf]"), key=lambda file: file.stat().st_mtime_ns):
        target = Path(next(names["image_path_iterator"])).with_suffix(file.suffix)
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
    "mobile_robots cars drones "
    "ros_map ros_messages sources robots doors warehouse_robot parking moving_obstacles roadmap corridor_proof "
    "drone_building drone_slit window_proof drawn_out packing best_placements z_tunnel large_map "
    "arm arm_line pull_arm compare_planners keep_away bare_ompl export_analysis report_figures"
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
    "image_scrapers": ("matplotlib", written_pictures),
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
        rf"\]\((?:\.\./)+({ROOT_PAGES})\.md\)", lambda m: f"]({up}{m[1].lower()}.md)", source[0]
    )


OBJECTS = {
    "arm": "cspace.Arm",
    "arm_space": "cspace.ArmSpace",
    "plan": "planners.Plan",
    "robot": "cspace.Robot",
    "space": "cspace.CSpace",
    "workspace": "cspace.Workspace",
}
"""Classes of the variables that the features table uses."""

OWNERS = ("cspace", "planners", "cspace.CSpace", "cspace.spectral", "planners.Plan")
"""Modules and classes searched, in this order, for a name without a prefix."""


TAKE_PARAMETERS = (
    "cspace.build",
    "cspace.CSpace.is_free",
    "planners.plan",
    "cspace.CSpace.find_path",
)
"""Functions searched, in this order, for a parameter without a function."""


def find(name: str) -> Any:
    """Return the object with a dotted name, or None if there is none."""
    package, *parts = name.split(".")
    try:
        return reduce(getattr, parts, import_module(package))
    except (AttributeError, ModuleNotFoundError, ValueError):
        return None


def full_name(name: str, before: str) -> str:
    """Return the full name of a function, class or parameter in the features table.

    A parameter such as ``exact=True`` links to the function that takes it. ``before`` is the full
    name before it in the same cell, or "": names without a prefix and parameters are looked up
    there first.
    """
    if name.startswith('"'):  # another value of the parameter before
        return before
    if "=" in name and "(" not in name:
        functions = [f for f in (before, *TAKE_PARAMETERS) if callable(find(f))]
        found = [
            f for f in functions if name.split("=")[0] in inspect.signature(find(f)).parameters
        ]
    else:
        first, _, rest = name.split("(")[0].partition(".")
        whole = f"{OBJECTS.get(first, first) if rest else first}.{rest}".rstrip(".")
        owner = OBJECTS.get(first, "") if rest else before
        if (rest or first) in getattr(find(owner), "__dataclass_fields__", ()):
            return owner  # whose page lists its fields
        candidates = [f"{owner}.{whole}" for owner in (before.rpartition(".")[0], *OWNERS) if owner]
        found = [c for c in (whole, *candidates) if "." in c and find(c) is not None]
    if not found:
        raise ValueError(
            f"docs/reference/features*.md: {name!r} is no public name; correct it, or add its owner to docs/conf.py"
        )
    return found[0]


def link_features(app: Any, page: str, source: list[str]) -> None:
    """Link each name in the first column of the features tables to its place in the API."""
    if page not in ("reference/features", "reference/features_planning"):
        return
    lines = source[0].splitlines()
    for i, line in enumerate(lines):
        if not line.startswith("| `") or line.startswith(
            "| `cspace "
        ):  # commands have a page of their own
            continue
        _, cell, rest = line.split("|", 2)
        before, links = "", list[str]()
        for name in re.findall("`(.+?)`", cell):
            before = full_name(name, before)
            links.append(f"{{py:obj}}`{name} <{before}>`")
        lines[i] = f"| {', '.join(links)} |{rest}"
    source[0] = "\n".join(lines)


def setup(app: Any) -> None:
    app.connect("source-read", at_home)
    app.connect("source-read", link_features)
