"""Each public name and option stands in a page that says how to use it, or in an example that runs."""

import inspect
import re
from functools import cache
from types import ModuleType

import pytest

from tests.helpers.repository import ROOT
from tests.lint.test_lists import PUBLIC_MODULES

RESULT = "a result, read by its attributes"
CAUGHT = "caught or filtered, as its message says"
NOT_SHOWN = {
    "AngleWarning": CAUGHT,
    "GeometryError": CAUGHT,
    "MeshWarning": CAUGHT,
    "MissingPackageError": CAUGHT,
    "UnitWarning": CAUGHT,
    "Chunk": RESULT,
    "Conflict": RESULT,
    "Contact": RESULT,
    "Element": RESULT,
    "HeadingRule": RESULT,
    "Lane": RESULT,
    "LaneVerdict": RESULT,
    "LineMotion": RESULT,
    "LostWay": RESULT,
    "NodeVerdict": RESULT,
    "Removals": RESULT,
    "Separation": RESULT,
    "Suggestion": RESULT,
    "Trial": RESULT,
    "Update": RESULT,
}
"""Public classes that no page needs to name, each with the reason."""

BLOCK = re.compile(r"^```(\w*).*?\n(.*?)^```", re.MULTILINE | re.DOTALL)
"""A block of a page: its language, and its lines."""


@cache
def find_words():
    """Return the words of all code that is shown, with flags of the command line as options.

    That is the code of examples, nodes and how-tos, in their sentences too, and the Python of all pages.
    """
    folders = (ROOT / "examples", ROOT / "ros")
    files = [path for folder in folders for path in folder.rglob("*.py")]
    code = [path.read_text(encoding="utf-8") for path in files]
    code += [path.read_text(encoding="utf-8") for path in (ROOT / "tutorials").glob("*.py")]
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        is_shown = page.parent.name == "howto" or page.name == "README.md"
        blocks = BLOCK.findall(text)
        code += [block for language, block in blocks if is_shown or language == "python"]
        if is_shown:
            code += re.findall(r"`([^`]+)`", BLOCK.sub("", text))
    everything = "\n".join(code)
    flags = re.findall(r"--(\w[\w-]*)", everything)
    return {*re.findall(r"\w+", everything), *(flag.replace("-", "_") for flag in flags)}


def is_ours(kind):
    return kind.__module__.partition(".")[0] in ("cspace", "planners")


def list_attributes(kind):
    """Yield the public attributes that our classes define, each with its function or None."""
    # A method of OMPL's, such as isValid, is shown by OMPL.
    theirs = {name for base in kind.__mro__ if not is_ours(base) for name in vars(base)}
    ours = [base for base in kind.__mro__ if is_ours(base)]
    names = {name for base in ours for name in (*vars(base), *inspect.get_annotations(base))}
    for name in sorted(names - theirs):
        if not name.startswith("_"):
            value = getattr(kind, name, None)
            is_call = inspect.isfunction(value) or inspect.ismethod(value)
            yield name, value if is_call else None


def list_options(function):
    """Return the parameters of a function that have a default."""
    parameters = inspect.signature(function).parameters.values()
    return [one.name for one in parameters if one.default is not one.empty]


def find_hidden(names, functions):
    """Return the names and options that stand nowhere."""
    hidden = {name for name in names if name.rpartition(".")[2] not in find_words()}
    for label, function in functions:
        missing = set(list_options(function)) - find_words()
        hidden |= {f"{label}({option}=)" for option in missing}
    return hidden


def list_public(module):
    """Return the public names of a module and their attributes, and the public functions."""
    names, functions = [], []
    for name in module.__all__:
        value = getattr(module, name)
        if isinstance(value, ModuleType):
            continue
        names.append(name)
        if not inspect.isclass(value):
            functions += [(name, value)] if callable(value) else []
            continue
        for attribute, function in list_attributes(value):
            names.append(f"{name}.{attribute}")
            functions += [(f"{name}.{attribute}", function)] if function else []
    return names, functions


@pytest.mark.parametrize("module", PUBLIC_MODULES, ids=lambda module: module.__name__)
def test_each_public_name_and_option_is_shown(module):
    assert find_hidden(*list_public(module)) - NOT_SHOWN.keys() == set()


def test_exceptions_are_few_and_needed():
    public = {name: getattr(module, name) for module in PUBLIC_MODULES for name in module.__all__}
    assert len(NOT_SHOWN) <= 20
    assert all(inspect.isclass(public[name]) for name in NOT_SHOWN)
    assert not NOT_SHOWN.keys() & find_words()


def test_a_name_that_stands_nowhere_is_found():
    def call(*, spacing=None, never_shown_option=None):
        pass

    names = ["Workspace", "Workspace.never_shown", "Workspace.from_mesh"]
    assert find_hidden(names, [("call", call)]) == {
        "Workspace.never_shown",
        "call(never_shown_option=)",
    }
