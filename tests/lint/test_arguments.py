"""No public function reads an argument with labels again after it was converted."""

import ast

from tests.lint.test_doors import parse_modules

CONVERTERS = ("check_", "select_positions", "evaluate")
"""Beginnings of the names of functions that convert an argument."""

EXCEPTIONS = {
    "check_cells": "converts itself",
    "evaluate": "answers in the type that it was asked in",
    "evaluate_edges": "answers in the type that it was asked in",
    "_of_value": "converts itself",
    "from_points": "asks for the names of columns, and for the size of numbers",
    "animate": "a path may be a plan or a trajectory, which is kept",
    "draw_arm": "a path may be a plan or a trajectory, which is kept",
    "make_scene": "a path may be a plan or a trajectory, which is kept",
    "cspace/view/_viewer.py: __init__": "a path may be a plan or a trajectory, which is kept",
    "cspace/_queries/gate.py: __init__": "the other branch converts it",
}
"""Functions that may, and why."""


def find_second_readings(function):
    """Yield arguments of arrays that are read as they came after a converter had them."""
    names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
    arguments = function.args
    for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs):
        if argument.annotation is None or "ArrayLike" not in ast.unparse(argument.annotation):
            continue
        calls = [
            node
            for node in ast.walk(function)
            if isinstance(node, ast.Call)
            and ast.unparse(node.func).startswith(CONVERTERS)
            and any(ast.unparse(value) == argument.arg for value in node.args)
        ]
        if not calls:
            continue
        harmless = {
            id(name)
            for node in ast.walk(function)
            if isinstance(node, ast.FormattedValue | ast.Raise | ast.Compare)
            for name in ast.walk(node)
        }
        first = min(call.end_lineno for call in calls)
        stored = [n.lineno for n in names if n.id == argument.arg and isinstance(n.ctx, ast.Store)]
        last = min(stored, default=10**9)
        for name in names:
            is_read = name.id == argument.arg and isinstance(name.ctx, ast.Load)
            if is_read and first < name.lineno < last and id(name) not in harmless:
                yield f"{function.name}: {argument.arg} in line {name.lineno}"


def test_arguments_are_not_read_again_after_they_were_converted():
    found = [
        f"{module}: {reading}"
        for module, tree in parse_modules()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for reading in find_second_readings(function)
        if not {function.name, f"{module}: {function.name}"} & EXCEPTIONS.keys()
    ]
    assert not found, "\n".join(found)
