"""Lists of the pages that are generated from the code: ``python docs/lists.py`` writes them anew."""

import pkgutil
import re
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import cspace._files
from cspace._files.formats import ROBOT_FORMATS, WORKSPACE_FORMATS
from cspace._shapes.primitives import SHORT_TEXTS
from cspace.export._maps import EXPORT_FORMATS

DOCS = Path(__file__).parent
MARKED = re.compile(r"(<!-- list: (.+?) -->\n).*?(<!-- end of list -->)", re.DOTALL)
MAPS_IN = {2: "plane", 3: "space", None: "either"}

FOR_PLANNERS = (
    "check_bounds, check_endpoint, dim, find_goals, has_cells, has_poses, in_memory, "
    "is_labelled, max_velocity, path_exists, resolution, search, searches, steps_between"
)
"""What planners ask of maps and arms; the page of Space describes it."""

INSIDE = {
    "CSpace": f"{FOR_PLANNERS}, boundary_proofs, facts, distances, find_cheap_path, find_unusable, kernel_map, path_obstacle_distance",
    "TiledCSpace": f"{FOR_PLANNERS}, facts, find_unusable, path_obstacle_distance, subproblems",
    "ArmSpace": FOR_PLANNERS,
    "Arm": "branch_to, check_configuration, check_configurations, check_limits, clamp, "
    "contact_samples, moving_pairs, ranges, rest, solve_pose, whole_turns",
    "JointMap": "undecided_pairs",
    "PlanningScene": "place",
    "Mesh": "cells, check_origin, facts, is_same, measure, rasters",
    "Rotations": "COORDINATES, KINDS, about_z, add_steps, all_limits, all_names, all_units, angles_to_centers, "
    "assign_slices, canonical_rotation, check_dimension, check_rotation, describe, draw_cells, "
    "facts, find_cells, find_cells_within, find_images, find_one_cell, find_yaw, format_rotation, "
    "from_matrix, from_stored_arrays, leading_axes, limits, make_canonical, make_lookups, "
    "make_matrices, make_shape_cells, neighbors, of_stored_arrays, of_value, only_rotation, preserve, rotate, "
    "rotation_between, rotation_matrices, sample, sample_near, slack, split_configurations, steps_between, "
    "stored_arrays, volumes",
}
"""Methods for the two packages only, by class; the API pages omit them."""


def fill(page: str) -> str:
    """Return a page with its lists made anew."""
    return MARKED.sub(lambda found: found[1] + make_list(found[2]) + found[3], page)


def make_list(name: str) -> str:
    """Return the lines of the list with a name."""
    return "".join(f"{line}\n" for line in LISTS[name]())


def list_short_texts() -> Iterable[str]:
    """Yield the rows of the short texts of robots."""
    yield from ("| shorthand | robot | in | example |", "|---|---|---|---|")
    for name, kind in SHORT_TEXTS.items():
        dimension = MAPS_IN[kind.dimension]
        yield f"| `{name}:{kind.form}` | {kind.summary} | {dimension} | `{kind.example}` |"


def list_formats(formats: Mapping[str, Any]) -> Iterable[str]:
    """Yield the rows of a table of formats; suffixes of one format share a row."""
    yield from ("| file | holds | map in |", "|---|---|---|")
    suffixes: dict[tuple[str, int | None], list[str]] = {}
    for suffix, known in formats.items():
        suffixes.setdefault((known.summary, known.dimension), []).append(suffix)
    for (summary, dimension), names in suffixes.items():
        shown = ", ".join(f"`{name}`" if name else "a folder" for name in names)
        yield f"| {shown} | {summary} | {MAPS_IN[dimension]} |"


def list_fields() -> Iterable[str]:
    """Yield the rows of the table of fields, in the order of the readers' modules."""
    yield from ("| file | honoured | refused | warned of |", "|---|---|---|---|")
    for module in pkgutil.iter_modules(cspace._files.__path__, "cspace._files."):
        for fields in getattr(import_module(module.name), "FIELDS", ()):
            done = ("; ".join(names) for names in fields[1:])
            yield f"| {' | '.join((fields.files, *done))} |"


LISTS: dict[str, Callable[[], Iterable[str]]] = {
    "short texts": list_short_texts,
    "workspace formats": lambda: list_formats(WORKSPACE_FORMATS),
    "robot formats": lambda: list_formats(ROBOT_FORMATS),
    "export formats": lambda: list_formats(EXPORT_FORMATS),
    "fields": list_fields,
}
"""Functions that make the lists of pages, by name."""


def main() -> None:
    """Write the lists of all pages."""
    for path in DOCS.rglob("*.md"):
        page = path.read_text(encoding="utf-8")
        if fill(page) != page:
            path.write_text(fill(page), encoding="utf-8")


if __name__ == "__main__":
    main()
