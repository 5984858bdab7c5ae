"""The core's public names and signatures, frozen in a file: ``python -m tests.lint.test_surface`` writes it.

A change of the file needs a line in ``CHANGELOG.md``; docs/reference/promises.md says what may change.
"""

import inspect
import runpy
from types import ModuleType

import cspace
from tests.helpers.repository import ROOT

SURFACE = ROOT / "tests" / "lint" / "surface.txt"
MADE_BY_USERS = ("Gate", "Grid", "Workspace", "ros.Mask", "ros.OccupancyGrid")
"""Classes whose constructor users call; others are made by functions and methods."""
LISTS = runpy.run_path(str(ROOT / "docs" / "lists.py"))


def list_surface():
    """Yield a line for each public name of the core, with parameters and defaults."""
    for name in sorted(set(cspace.__all__) - {"errors"}):
        value = getattr(cspace, name)
        is_module = isinstance(value, ModuleType)
        home = value.__name__ if is_module else LISTS["find_home"](name)
        if LISTS["is_experimental"](home):
            continue
        if is_module:
            for own in sorted(value.__all__):
                yield from describe(f"{name}.{own}", getattr(value, own))
        else:
            yield from describe(name, value)


def describe(name, value):
    """Yield lines for a function, a constant, or a class with its public members."""
    if not inspect.isclass(value):
        yield f"{name}{sign(value)}" if callable(value) else f"{name} = {value!r}"
        return
    bases = [base for base in value.__mro__ if base.__module__.partition(".")[0] == "cspace"]
    yield f"class {name}{sign(value) if name in MADE_BY_USERS else ''}"
    members = {own for base in bases for own in {**vars(base), **inspect.get_annotations(base)}}
    for own in sorted(own for own in members if not own.startswith("_")):
        member = getattr(value, own, None)
        # A method that a wing lends is as experimental as the wing.
        if not LISTS["is_experimental"](getattr(member, "__module__", None) or "cspace"):
            yield f"{name}.{own}{sign(member) if callable(member) else ''}"


def sign(function):
    """Return the parameters of a function with their defaults, without types."""
    signature = inspect.signature(function)
    empty = inspect.Signature.empty
    bare = [each.replace(annotation=empty) for each in signature.parameters.values()]
    return str(signature.replace(parameters=bare, return_annotation=empty))


def test_names_and_signatures_of_the_core_are_those_of_the_file():
    assert list(list_surface()) == SURFACE.read_text(encoding="utf-8").splitlines()


if __name__ == "__main__":
    SURFACE.write_text("".join(f"{line}\n" for line in list_surface()), encoding="utf-8")
