"""Hints name what is ours, with values, or a page; a test follows each of them."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from cspace._files.access import BRING_YOUR_FILE

ROOT = Path(__file__).parents[2]

DESCRIPTIONS = "cspace/view/_page.py"
"""File whose hints describe controls of a page."""

ADVICE = re.compile(
    r"\w\(|\w=|--\w|\b(?:add|ask|build|call|convert|export|leave|pass|run|set|use|write) "
)
"""Part of a hint that names a call, an option or an edit."""

QUOTED_CHARACTERS = 9
"""Smallest length of a text in a test that quotes a part of a hint."""


@cache
def parse(folder: str) -> dict[str, ast.Module]:
    """Parse the Python files of a folder, by name."""
    files = sorted((ROOT / folder).rglob("*.py"))
    return {str(file.relative_to(ROOT)): ast.parse(file.read_text()) for file in files}


def find_positions(trees: list[ast.Module]) -> dict[str, int]:
    """Return the position of the argument ``hint`` of each function or class that has one."""
    positions = {}
    for node in (node for tree in trees for node in ast.walk(tree)):
        if not isinstance(node, ast.Module | ast.ClassDef):
            continue
        for function in (part for part in node.body if isinstance(part, ast.FunctionDef)):
            arguments = [argument.arg for argument in function.args.args]
            if "hint" not in arguments:
                continue
            is_method = isinstance(node, ast.ClassDef)
            name = node.name if function.name == "__init__" else function.name
            positions[name] = arguments.index("hint") - is_method
    return positions


def iterate_hints(
    tree: ast.Module, positions: dict[str, int], warn: str = "warn_user"
) -> Iterator[ast.expr]:
    """Yield the expression of each hint in a file, and of each text that `warn` takes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and not isinstance(node.value, ast.Call):
            if any(ast.unparse(target).lower().endswith("hint") for target in node.targets):
                yield node.value
        elif isinstance(node, ast.Call):
            name = ast.unparse(node.func).rpartition(".")[2]
            position = 0 if name == warn else positions.get(name, 3)
            if (name in positions or name == warn or name.endswith("Error")) and node.args:
                yield from node.args[position : position + 1]
            yield from (keyword.value for keyword in node.keywords if keyword.arg == "hint")


def list_texts(expression: ast.expr) -> list[list[str]]:
    """Return the texts that an expression may be; values split each into several pieces."""
    if isinstance(expression, ast.Constant):
        return [[expression.value]] if isinstance(expression.value, str) else []
    if isinstance(expression, ast.JoinedStr):
        return [[part.value for part in expression.values if isinstance(part, ast.Constant)]]
    if isinstance(expression, ast.IfExp):
        return list_texts(expression.body) + list_texts(expression.orelse)
    return []


@cache
def list_hints() -> list[tuple[str, int, list[str]]]:
    """Return the file, the line and the pieces of each hint that names something to do."""
    sources = parse("cspace") | parse("planners")
    positions = find_positions(list(sources.values()))
    hints = []
    for file, tree in sources.items():
        for expression in iterate_hints(tree, positions):
            texts = list_texts(expression)
            hints += [
                (file, expression.lineno, text) for text in texts if ADVICE.search("x".join(text))
            ]
    return hints


@cache
def list_quotes() -> list[str]:
    """Return the texts in tests; backslashes of patterns are removed."""
    quotes = set()
    for file, tree in parse("tests").items():
        for node in ast.walk(tree):
            if (
                isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and "lint" not in file
            ):
                quotes.add(re.sub(r"\\(.)", r"\1", node.value))
    return sorted(quote for quote in quotes if len(quote) >= QUOTED_CHARACTERS)


def is_quoted(pieces: list[str], quotes: list[str]) -> bool:
    """Return True if a text in a test is a part of a hint, or has it with its values."""
    if any(quote in piece for piece in pieces for quote in quotes):
        return True
    return re.search(".+?".join(map(re.escape, pieces)), "\n".join(quotes)) is not None


def test_every_hint_that_names_something_to_do_is_followed_by_a_test():
    untested = [
        f"{file}:{line}: {'...'.join(pieces)}"
        for file, line, pieces in list_hints()
        if not is_quoted(pieces, list_quotes())
    ]
    assert len(list_hints()) > 100
    assert not untested, "\n".join(untested)


def list_constants(expression: ast.expr) -> list[str]:
    """Return the texts without values that a hint may be."""
    if isinstance(expression, ast.IfExp):
        return list_constants(expression.body) + list_constants(expression.orelse)
    value = getattr(expression, "value", None)
    return [value] if isinstance(value, str) else []


@cache
def list_own_names() -> frozenset[str]:
    """Return our options of calls and commands, and our calls, as hints write them."""
    names = set()
    for tree in (*parse("cspace").values(), *parse("planners").values()):
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(f"{node.name}(")
            elif isinstance(node, ast.arg):
                names.add(f"{node.arg}=")
            elif isinstance(node, ast.AnnAssign):  # fields of records
                names.add(f"{ast.unparse(node.target)}=")
            elif isinstance(node, ast.Constant) and str(node.value).startswith("--"):
                names.add(str(node.value))
    return frozenset(names)


def find_names(text: str) -> list[str]:
    """Return the options and calls that a hint names."""
    return re.findall(r"(?<![-\w])\w+=|--[a-z][-a-z]*|[.\w]+\(", text)


def test_every_option_and_call_that_a_hint_names_is_ours():
    named = {
        name for _, _, pieces in list_hints() for piece in pieces for name in find_names(piece)
    }
    # Options of commands are named after those of calls, unless they are written out.
    calls = {f"--{name[:-1].replace('_', '-')}" for name in list_own_names() if name.endswith("=")}
    ours = {name.rpartition(".")[2] for name in named}
    assert len(ours) > 40
    assert not sorted(ours - list_own_names() - calls)


def test_a_constant_hint_names_an_option_or_a_call_of_ours_or_a_page():
    sources = parse("cspace") | parse("planners")
    positions = find_positions(list(sources.values()))
    vague = [
        f"{file}:{expression.lineno}: {text}"
        for file, tree in sources.items()
        if file != DESCRIPTIONS
        for expression in iterate_hints(tree, positions, "")
        for text in list_constants(expression)
        if not names_ours(text)
    ]
    assert not vague, "\n".join(vague)


def names_ours(text: str) -> bool:
    """Return True for an empty hint, and for a page, an option, a call or an attribute of ours."""
    own = {name.rstrip("(=") for name in list_own_names()}
    attributes = set(re.findall(r"\b[A-Za-z]\w*\.(\w+)", text))
    is_page = text in ("", BRING_YOUR_FILE)
    return is_page or bool(find_names(text)) or not attributes.isdisjoint(own)


@pytest.mark.parametrize(
    "code",
    [
        'raise InputError("a", "is 1", "it must be 2", "pass frobnicate=2")',
        'hint = f"pass frobnicate={n}"',
        'warn_user("odd; call frobnicate(2)")',
        'raise make(hint="use --frobnicate")',
        'def make(a, hint): ...\nraise make(1, "write frobnicate")',
        'raise InputError("a", "b", "c", "pass frobnicate=2" if a else "remove it")',
    ],
)
def test_a_new_hint_without_a_test_is_found(code):
    tree = ast.parse(code)
    hints = list(iterate_hints(tree, find_positions([tree])))
    pieces = [text for hint in hints for text in list_texts(hint)]
    assert any(ADVICE.search("x".join(text)) for text in pieces)
    assert not is_quoted(pieces[0], list_quotes())
