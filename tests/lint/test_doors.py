"""Only cspace._files reads what others wrote; each check of what comes in stands in one function."""

import ast
from functools import cache

from tests.helpers.repository import ROOT

READERS = ("cspace/_files/", "cspace/_record/", "cspace/_tiles/")
"""Folders that read: files of others, and the format of saved maps."""

OTHERS = {
    "cspace/_support/limits.py": "the memory of a container",
    "cspace/_files/lazy_arrays.py": "an array of the caller in memory, mapped again in another process",
    "cspace/_support/compiling.py": "its own lock and compiled code",
    "cspace/_outside.py": "the stub beside it",
}
"""Files that read what no user passes, each with what it is."""

PARSERS = {
    *("yaml.load", "yaml.load_all", "yaml.safe_load", "yaml.safe_load_all", "json.load"),
    *("json.loads", "ElementTree.parse", "ElementTree.fromstring", "ElementTree.XML"),
    *("Image.open", "np.load", "np.loadtxt", "np.genfromtxt", "np.fromfile", "np.memmap"),
    *(
        "numpy.load",
        "pickle.load",
        "pickle.loads",
        "zarr.open",
        "trimesh.load",
        "xarray.open_dataset",
    ),
}
"""Functions that parse or open a file."""

CHECKS = {
    "warn_of_large": "cspace/_support/units.py",
    "suggest_call": "cspace/_support/kinds.py",
    "suggest_name": "cspace/_support/check.py",
    "warn_of_names": "cspace/_files/fields.py",
    "check_crs": "cspace/_files/crs.py",
    "warn_of_notes": "cspace/_files/unit_notes.py",
}
"""Checks of angles, names, fields, frames and units, by the file that defines each alone."""


@cache
def parse_modules():
    """Return the name and the syntax tree of each module of the product."""
    paths = (path for folder in ("cspace", "planners") for path in (ROOT / folder).rglob("*.py"))
    return [
        (str(path.relative_to(ROOT)), ast.parse(path.read_text(encoding="utf-8")))
        for path in sorted(paths)
    ]


def find_reads(tree):
    """Yield the calls of a module that read a file, or parse a text in a format of others."""
    for node in (node for node in ast.walk(tree) if isinstance(node, ast.Call)):
        name = ast.unparse(node.func)
        is_file_method = name.endswith((".read_text", ".read_bytes"))
        words = [*node.args, *(keyword.value for keyword in node.keywords)]
        modes = [word.value for word in words if isinstance(word, ast.Constant)]
        may_open = name == "open" or name.endswith(".open")
        is_open = may_open and all(
            isinstance(mode, str) and set(mode) <= set("rbt") for mode in modes
        )
        is_class = name.partition(".")[0][:1].isupper() or name.startswith(("cspace.", "cls."))
        if name in PARSERS or is_file_method or (is_open and not is_class):
            yield f"{name} in line {node.lineno}"


def test_only_readers_read():
    found = {
        f"{name}: {call}"
        for name, tree in parse_modules()
        if not name.startswith(READERS) and name not in OTHERS
        for call in find_reads(tree)
    }
    assert not found
    readers = [name for name, tree in parse_modules() if any(find_reads(tree))]
    assert set(OTHERS) < set(readers) and len(readers) > 8


def test_each_check_of_what_comes_in_is_defined_once():
    for check, home in CHECKS.items():
        places = [
            name
            for name, tree in parse_modules()
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef) and node.name.strip("_") == check
        ]
        assert places == [home], check
