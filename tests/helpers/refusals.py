"""Tables of refused calls and files, and their messages."""

import ast
import json
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from cspace.errors import CspaceError


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows whose last value, parts of a message, is the id."""
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in rows])


def check_refused(call: Callable[[], Any], message: str) -> None:
    """Check that a call is refused in one line that has the parts of a text.

    The parts are an argument with its value, and words that tell the rule; " ... " separates them,
    because the sentence stands in the product alone.
    """
    with pytest.raises(CspaceError) as caught:
        call()
    line = str(caught.value)
    parts = map(re.escape, message.split(" ... "))
    assert "\n" not in line and re.search(".*".join(parts), line), line


def write(folder: Path, name: str, content: Any) -> Path:
    """Write bytes, a text, or a document as JSON, and return its path."""
    if not isinstance(content, bytes | str):
        content = json.dumps(content, default=list)
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder / name


def list_calls(hint: str) -> list[str]:
    """Return the expressions that a hint names: of each way, the longest text that is one."""
    calls = []
    for way in hint.removeprefix("use ").split(", or "):
        for end in range(len(way), 0, -1):
            with suppress(SyntaxError):
                ast.parse(way[:end].strip(), mode="eval")
                calls.append(way[:end].strip())
                break
    return calls
