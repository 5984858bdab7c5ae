"""Lists of the pages that are generated from the code: ``python docs/lists.py`` writes them anew."""

import ast
import pkgutil
import re
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

import cspace
import cspace._files
from cspace._files.formats import ROBOT_FORMATS, WORKSPACE_FORMATS
from cspace._shapes.primitives import SHORTHANDS
from cspace.export._writers import EXPORT_FORMATS
from planners._catalogue import PlannerName, find_planner
from planners._space_kinds import SPACE_KINDS, SUPPORTED

DOCS = Path(__file__).parent
MARKED = re.compile(r"(<!-- list: (.+?) -->\n).*?(<!-- end of list -->)", re.DOTALL)
EXPERIMENTAL = (
    "*Experimental*: names, options and files may change in a minor version. Its proofs hold."
)
"""What a page says of all that is not in the core."""

MAPS_IN = {2: "plane", 3: "space", None: "either"}


READERS = DOCS.parent / "examples/readers"
"""Scripts that read files of other packages, which pages show."""


def fill(page: str) -> str:
    """Return a page with its lists made anew."""
    return MARKED.sub(lambda found: found[1] + make_list(found[2]) + found[3], page)


def make_list(name: str) -> str:
    """Return the lines of the list with a name, or a script and a call of it."""
    reader, _, call = name.partition(": ")
    lines = show_reader(*reader.split(" of "), call) if call else LISTS[name]()
    return "".join(f"{line}\n" for line in lines)


def show_reader(language: str, name: str, call: str) -> Iterable[str]:
    """Yield a script without its command line, and a call of its function; ``py`` is not run."""
    text = (READERS / f"{name}.py").read_text(encoding="utf-8")
    code = text.partition("\n\nif __name__")[0].splitlines()
    yield from (f"```{language}", *code, "", "", call, "```")


def read_parts(heading: str) -> list[str]:
    """Return the files and folders in a table of the page on architecture; folders end in "/"."""
    page = (DOCS / "explanation/architecture.md").read_text(encoding="utf-8")
    section = page.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    cells = re.findall(r"^\| (`.+?) \|", section, re.MULTILINE)
    return [part for cell in cells for part in re.findall(r"`(\w+/?)`", cell)]


AROUND = read_parts("Around the core")
"""Parts of the product that are experimental."""

CORE = read_parts("The core")
"""Parts of ``cspace`` that promise to stay as they are."""


def is_experimental(module: str) -> bool:
    """Return whether a module is not part of the core."""
    package, _, rest = module.partition(".")
    part = rest.partition(".")[0] if package == "cspace" else package
    return f"{part}/" in AROUND


def list_promises() -> Iterable[str]:
    """Yield the rows of the public names of ``cspace``, by what they promise."""
    promises: dict[bool, list[str]] = {False: [], True: []}
    for name in cspace.__all__:
        value = getattr(cspace, name)
        module = value.__name__ if isinstance(value, ModuleType) else find_home(name)
        promises[is_experimental(module)].append(f"`{name}`")
    yield from ("| promise | names of `cspace` |", "|---|---|")
    yield f"| stay in all versions 1.x | {', '.join(promises[False])} |"
    yield f"| *experimental*, as is `planners` | {', '.join(promises[True])} |"


def find_home(name: str) -> str:
    """Return the module that holds a public name."""
    stub = (DOCS.parent / "cspace" / "__init__.pyi").read_text(encoding="utf-8")
    home = re.search(rf"^from \.(\S+) import {name} as", stub, re.MULTILINE)
    return f"cspace.{home[1]}" if home else "cspace"


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
    readers = ("moveit_messages", "sphere_files", "urdf")
    arms = (f"cspace.arms._reading.{name}" for name in readers)
    others = "cspace.lanes._graph_files", "cspace.regions._cover", "planners._motion.joint_limits"
    for name in (*(module.name for module in modules), *arms, *others):
        for fields in getattr(import_module(name), "FIELDS", ()):
            yield f"| {' | '.join(fields[:4])} |"


def list_skills() -> Iterable[str]:
    """Yield the rows of the options that planners take, those alike in one row."""
    yield from (
        "| planner | `drive` | `objective` | `keep` | `iterations` | `range` |",
        "|---|---|---|---|---|---|",
    )
    alike: dict[str, list[str]] = {}
    for planner in map(find_planner, get_args(PlannerName)):
        options = [", ".join(words) for words in planner.list_taken().values()]
        settings = [planner.counts_iterations, planner.has_range]
        row = [*options, *("yes" if setting else "no" for setting in settings)]
        alike.setdefault(" | ".join(row), []).append(planner.name)
    for row, names in alike.items():
        yield f"| {', '.join(names)} | {row} |"


def list_supported() -> Iterable[str]:
    """Yield the rows of the goals and options that spaces take."""
    yield f"| `planners.plan` takes | {' | '.join(SPACE_KINDS)} |"
    yield "|---" * (1 + len(SPACE_KINDS)) + "|"
    for option, kinds in SUPPORTED.items():
        marks = ("yes" if kind in kinds else "no" for kind in SPACE_KINDS)
        yield f"| {option} | {' | '.join(marks)} |"


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
    stub = path.with_suffix(".pyi")
    if stub.exists() and (home := re.search(rf"from (\S+) import {name} as", stub.read_text())):
        return find_summary(f"cspace{home[1]}", name)
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
            target = ast.unparse(statement).partition("=")[0].partition(":")[0]
            # Constants that follow each other share the docstring after the last one.
            docstrings = [one.value for one in statements[number:] if isinstance(one, ast.Expr)]
            if docstrings and name in re.findall(r"\w+", target):
                return str(ast.literal_eval(docstrings[0])).partition("\n")[0]
    raise LookupError(f"{module}.{name} has no docstring")


LISTS: dict[str, Callable[[], Iterable[str]]] = {
    "experimental": lambda: [EXPERIMENTAL],
    "promises": list_promises,
    "shorthands": list_shorthands,
    "workspace formats": lambda: list_formats(WORKSPACE_FORMATS),
    "robot formats": lambda: list_formats(ROBOT_FORMATS),
    "export formats": lambda: list_formats(EXPORT_FORMATS),
    "fields": list_fields,
    "inner door": list_inside,
    "options of planners": list_skills,
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
