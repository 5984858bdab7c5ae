"""Lists of the pages that are generated from the code: ``python docs/lists.py`` writes them anew."""

import inspect
import pkgutil
import re
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import cspace
import cspace._files
import planners
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


def fill(page: str, *, linked: bool = False) -> str:
    """Return a page with its lists made anew; in the site, names link to their place in the API."""
    return MARKED.sub(lambda found: found[1] + make_list(found[2], linked) + found[3], page)


def make_list(name: str, linked: bool) -> str:
    """Return the lines of the list with a name."""
    tables: dict[str, Callable[[], Iterable[str]]] = {
        "short texts": list_short_texts,
        "workspace formats": lambda: list_formats(WORKSPACE_FORMATS),
        "robot formats": lambda: list_formats(ROBOT_FORMATS),
        "export formats": lambda: list_formats(EXPORT_FORMATS),
        "fields": list_fields,
    }
    lines = tables[name]() if name in tables else list_names(find_names()[name], linked)
    return "".join(f"{line}\n" for line in lines)


# ---- formats and short texts ---------------------------------------------------------------------


def list_short_texts() -> Iterable[str]:
    """Yield the rows of the short texts of robots."""
    yield from ("| text | robot | in | example |", "|---|---|---|---|")
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
            yield f"| {' | '.join(fields)} |"


# ---- functions and methods -----------------------------------------------------------------------


def find_names() -> dict[str, list[str]]:
    """Return the full names of public functions and methods, by list."""
    space, memory = methods("cspace.Space"), methods("cspace.CSpace")
    tiled, arm = methods("cspace.TiledCSpace"), methods("cspace.ArmSpace")
    every_map = (memory & tiled) - space
    return {
        "functions": [
            *functions("cspace"),
            *functions("cspace.arms"),
            *functions("cspace.plot"),
            *functions("cspace.spectral"),
        ],
        "planners": functions("planners"),
        "Workspace": full("cspace.Workspace", methods("cspace.Workspace")),
        "Robot": full("cspace.Robot", methods("cspace.Robot")),
        "every space": full("cspace.Space", space),
        "every map": full("cspace.CSpace", every_map),
        "maps in memory": full("cspace.CSpace", memory - space - every_map),
        "tiled maps": full("cspace.TiledCSpace", tiled - space - every_map),
        "arm spaces": full("cspace.ArmSpace", arm - space),
        "Arm": full("cspace.Arm", methods("cspace.Arm")),
        "Plan": full("planners.Plan", methods("planners.Plan")),
        "Trajectory": full("planners.Trajectory", methods("planners.Trajectory")),
    }


def full(owner: str, names: Iterable[str]) -> list[str]:
    """Return the sorted full names of methods of a class."""
    return [f"{owner}.{name}" for name in sorted(names)]


def methods(owner: str) -> set[str]:
    """Return the names of the public methods of a class, except those for the packages only."""
    kind = find(owner)
    inside = FOR_PLANNERS if kind is cspace.Space else INSIDE.get(kind.__name__, "")
    callables = {name for name, _ in inspect.getmembers(kind, callable)}
    return {name for name in callables if not name.startswith("_")} - set(inside.split(", "))


def functions(package: str) -> list[str]:
    """Return the full names of the functions of a package, and of the callbacks for OMPL."""
    module = import_module(package)
    values = {name: getattr(module, name) for name in module.__all__}
    if module is not cspace:  # which lists some functions of its packages, too
        values = {name: value for name, value in values.items() if not is_in_cspace(name, value)}
    return [
        f"{package}.{name}"
        for name, value in values.items()
        if inspect.isfunction(value) or is_callback(value)
    ]


def is_in_cspace(name: str, value: object) -> bool:
    """Return True if ``cspace`` has a value by the same name."""
    return name in dir(cspace) and getattr(cspace, name) is value


def is_callback(value: object) -> bool:
    """Return True if a value is a class of planners that OMPL calls."""
    return inspect.isclass(value) and any(
        base.__module__.startswith("ompl") for base in value.__mro__
    )


def find(name: str) -> Any:
    """Return the object with a full name."""
    value: Any = {"cspace": cspace, "planners": planners}[name.partition(".")[0]]
    for part in name.split(".")[1:]:
        value = getattr(value, part)
    return value


def list_names(names: Iterable[str], linked: bool) -> Iterable[str]:
    """Yield a line for each name: its last part, and the first line of its docstring."""
    for name in names:
        text = str(inspect.getdoc(find(name))).splitlines()[0]
        text = re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text).replace("``", "`")
        owner, _, last = name.rpartition(".")
        short = last if inspect.isclass(find(owner)) else name
        yield f"* {f'{{py:obj}}`{short} <{name}>`' if linked else f'`{short}`'}: {text}"


def main() -> None:
    """Write the lists of all pages."""
    for path in DOCS.rglob("*.md"):
        page = path.read_text(encoding="utf-8")
        if fill(page) != page:
            path.write_text(fill(page), encoding="utf-8")


if __name__ == "__main__":
    main()
