"""Hints name options of the call that refused, or name the call that has them."""

import ast
import inspect
import re
import sys
from collections import defaultdict
from functools import cache

import cspace
from cspace._support import check
from tests.helpers.repository import SOURCES

OPTION = re.compile(r"(?<![-\w.<])([a-z]\w*)=")
"""Option of a call in a hint, as ``margin=0.1``."""

CALL = re.compile(r"\.(\w+)|(\w+)\(|(\w+_\w+|[A-Z]\w+)")
"""Name of a call in a hint."""

ANY = "**"
"""Stands for the options of a call that passes them on."""


@cache
def list_owners():
    """Return the names of the functions, methods and classes that take each option."""
    owners = defaultdict(set)
    for file in SOURCES.values():
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef):
                add_owner(owners, node.name, node)
            elif isinstance(node, ast.ClassDef):
                for part in node.body:
                    if isinstance(part, ast.AnnAssign):  # a field of a record
                        owners[ast.unparse(part.target)].add(node.name)
                    elif isinstance(part, ast.FunctionDef) and part.name == "__init__":
                        add_owner(owners, node.name, part)
    return owners


def add_owner(owners, name, function):
    """Note that a call takes the arguments of a function."""
    arguments = function.args.posonlyargs + function.args.args + function.args.kwonlyargs
    for option in [argument.arg for argument in arguments] + [ANY] * bool(function.args.kwarg):
        owners[option].add(name)


def list_taken(frame):
    """Return the arguments of our calls that are running, or None if they cannot be told."""
    taken = set()
    outermost = ""
    while frame:
        name = frame.f_globals.get("__name__", "")
        if name.startswith(("cspace", "planners", "examples")) and name != check.__name__:
            code = frame.f_code
            if code.co_flags & inspect.CO_VARKEYWORDS:  # its options may have any name
                return None
            arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
            taken.update(arguments)
            is_method = arguments[:1] in (("self",), ("cls",))
            outermost = "" if is_method else code.co_name
        frame = frame.f_back
    packages = cspace, sys.modules.get("planners")
    is_public = not outermost or any(hasattr(package, outermost) for package in packages)
    return taken if is_public else None


def check_hint(hint):
    """Raise AssertionError if a hint names an option of another call without the call's name."""
    options = set(OPTION.findall(re.sub("<[^>]*>", "", hint)))
    taken = list_taken(sys._getframe(1)) if options else None
    for option in options - taken if taken is not None else ():
        named = {word for words in CALL.findall(hint) for word in words}
        owners = list_owners()[option] | list_owners()[ANY]
        # Calls of other libraries are listed in tests/lint/test_hints.py.
        callers = set(re.findall(rf"(\w+)\([^()]*\b{option}=", hint))
        is_foreign = bool(callers) and not callers & set().union(*list_owners().values())
        assert named & owners or is_foreign, (
            f"{hint!r} names the option {option}, which the call that refused does not have"
        )
