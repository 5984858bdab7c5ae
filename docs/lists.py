"""Lists of the pages that are generated from the code: ``python docs/lists.py`` writes them anew."""

import ast
import pkgutil
import re
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import cspace._files
from cspace._files.formats import ROBOT_FORMATS, WORKSPACE_FORMATS
from cspace._shapes.primitives import SHORTHANDS
from cspace.export._writers import EXPORT_FORMATS
from planners._catalogue import REFUSALS, SPACE_KINDS, SUPPORTED

DOCS = Path(__file__).parent
MARKED = re.compile(r"(<!-- list: (.+?) -->\n).*?(<!-- end of list -->)", re.DOTALL)
MAPS_IN = {2: "plane", 3: "space", None: "either"}


def fill(page: str) -> str:
    """Return a page with its lists made anew."""
    return MARKED.sub(lambda found: found[1] + make_list(found[2]) + found[3], page)


def make_list(name: str) -> str:
    """Return the lines of the list with a name."""
    return "".join(f"{line}\n" for line in LISTS[name]())


def list_shorthands() -> Iterable[str]:
    """Yield the rows of the shorthands of robots."""
    yield from ("| shorthand | robot | in | example |", "|---|---|---|---|")
    for name, kind in SHORTHANDS.items():
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
    modules = pkgutil.iter_modules(cspace._files.__path__, "cspace._files.")
    arms = (f"cspace.arms.{name}" for name in ("_moveit_messages", "_sphere_files", "_urdf"))
    others = "cspace.lanes._graph_files", "cspace.regions._cover"
    for name in (*(module.name for module in modules), *arms, *others):
        for fields in getattr(import_module(name), "FIELDS", ()):
            yield f"| {' | '.join(fields[:4])} |"


def list_refusals() -> Iterable[str]:
    """Yield the rows of the options that planners refuse."""
    yield from ("| planner | refuses | because it |", "|---|---|---|")
    for options, reason in REFUSALS:
        values = {option: ", ".join(map(str, refused)) for option, refused in options.items()}
        names = values.pop("planner")
        refused = " with ".join(f"`{option}`: {value}" for option, value in values.items())
        yield f"| {names} | {refused or 'every plan'} | {reason} |"


def list_supported() -> Iterable[str]:
    """Yield the rows of the goals and options that spaces take."""
    yield f"| `planners.plan` takes | {' | '.join(SPACE_KINDS)} |"
    yield "|---" * (1 + len(SPACE_KINDS)) + "|"
    for option, kinds in SUPPORTED.items():
        shown = option if " " in option else f"`{option}`"
        marks = ("yes" if kind in kinds else "no" for kind in SPACE_KINDS)
        yield f"| {shown} | {' | '.join(marks)} |"


def list_inside() -> Iterable[str]:
    """Yield the rows of the names of the inner door, by the module that holds each."""
    yield from ("| name | what it is | from |", "|---|---|---|")
    stub = (DOCS.parent / "cspace" / "inside.pyi").read_text(encoding="utf-8")
    for module, name in re.findall(r"^from \.(\S+) import (\w+) as", stub, re.MULTILINE):
        summary = find_summary(f"cspace.{module}", name)
        yield f"| `{name}` | {summary} | `{module}` |"


def find_summary(module: str, name: str) -> str:
    """Return the first line of the docstring of a name, which may be a constant."""
    path = Path(str(import_module(module).__file__))
    if (path.parent / f"{name}.py").exists():
        return str(import_module(f"{module}.{name}").__doc__).partition("\n")[0]
    statements = ast.parse(path.read_text(encoding="utf-8")).body
    for number, statement in enumerate(statements):
        if isinstance(statement, ast.ImportFrom) and name in {one.name for one in statement.names}:
            return find_summary(str(statement.module), name)
        is_defined = isinstance(statement, ast.FunctionDef | ast.ClassDef)
        if is_defined and statement.name == name:
            return str(ast.get_docstring(statement)).partition("\n")[0]
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            after = statements[number + 1]
            is_named = ast.unparse(statement).startswith((f"{name}:", f"{name} ="))
            if is_named and isinstance(after, ast.Expr):
                return str(ast.literal_eval(after.value)).partition("\n")[0]
    raise LookupError(f"{module}.{name} has no docstring")


LISTS: dict[str, Callable[[], Iterable[str]]] = {
    "shorthands": list_shorthands,
    "workspace formats": lambda: list_formats(WORKSPACE_FORMATS),
    "robot formats": lambda: list_formats(ROBOT_FORMATS),
    "export formats": lambda: list_formats(EXPORT_FORMATS),
    "fields": list_fields,
    "inner door": list_inside,
    "refusals of planners": list_refusals,
    "goals and options of spaces": list_supported,
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
