"""No public function reads an argument with labels again after it was converted."""

import ast

from tests.lint.test_doors import parse_modules

CONVERTERS = ("check_", "select_positions", "evaluate")
"""Beginnings of the names of functions that convert an argument."""


def list_branches(function):
    """List pairs of branches of a function of which only one is run, as sets of nodes."""
    return [
        [
            {id(node) for part in branch for node in ast.walk(part)}
            for branch in (each.body, each.orelse)
        ]
        for each in ast.walk(function)
        if isinstance(each, ast.If)
    ]


def find_second_readings(function):
    """Yield arguments of arrays that are read as they came after a converter had them."""
    names = [node for node in ast.walk(function) if isinstance(node, ast.Name)]
    branches = list_branches(function)
    # A call whose value nobody takes checks and converts nothing.
    checks = {id(node.value) for node in ast.walk(function) if isinstance(node, ast.Expr)}
    arguments = function.args
    for argument in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs):
        if argument.annotation is None or "ArrayLike" not in ast.unparse(argument.annotation):
            continue
        calls = [
            node
            for node in ast.walk(function)
            if isinstance(node, ast.Call)
            and id(node) not in checks
            and ast.unparse(node.func).startswith(CONVERTERS)
            and any(ast.unparse(value) == argument.arg for value in node.args)
        ]
        harmless = {
            id(name)
            for node in ast.walk(function)
            if isinstance(node, ast.FormattedValue | ast.Raise | ast.Compare)
            for name in ast.walk(node)
        }
        stored = [n.lineno for n in names if n.id == argument.arg and isinstance(n.ctx, ast.Store)]
        last = min(stored, default=10**9)
        for name in names:
            is_read = name.id == argument.arg and isinstance(name.ctx, ast.Load)
            converted = [
                call
                for call in calls
                if call.end_lineno < name.lineno
                and not any(id(call) in one and id(name) in other for one, other in branches)
            ]
            if is_read and converted and name.lineno < last and id(name) not in harmless:
                yield f"{function.name}: {argument.arg} in line {name.lineno}"


def test_arguments_are_not_read_again_after_they_were_converted():
    found = [
        f"{module}: {reading}"
        for module, tree in parse_modules()
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef)
        for reading in find_second_readings(function)
    ]
    assert not found, "\n".join(found)
