"""Imports run one way: no circle of modules, with those within functions and for type checkers counted."""

import ast
from collections.abc import Iterator
from graphlib import TopologicalSorter
from importlib.util import find_spec
from pathlib import Path

FOLDERS = [Path(str(spec.origin)).parent for name in ("cspace", "planners") if (spec := find_spec(name))]
FILES = {
    ".".join(file.relative_to(folder.parent).with_suffix("").parts).removesuffix(".__init__"): file
    for folder in FOLDERS
    for file in folder.rglob("*.py")
}


def imported(name: str) -> Iterator[str]:
    """Modules that a module imports, wherever it does so, by name."""
    for node in ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{name} imports by a relative name"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in FILES else str(node.module)


def test_no_circle() -> None:
    graph = {name: {other for other in imported(name) if other in FILES and other != name} for name in FILES}
    assert len(list(TopologicalSorter(graph).static_order())) == len(FILES)
    plan = {name.split(".")[1] for name, others in graph.items() if name.startswith("cspace.") and "planners" in others}
    assert plan == {"cli"}  # maps know nothing of those who plan on them
