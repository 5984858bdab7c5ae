"""Tables of refused arguments and their messages."""

from collections.abc import Callable
from typing import Any

import pytest

from cspace.errors import CspaceError


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows whose last value, part of a message, is the id."""
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in rows])


def check_followed(call: Callable[[], Any], advised: Callable[[], Any], message: str) -> None:
    """Check that a call is refused in one line, which ends with a hint, and that following it helps.

    ``message`` is a part of the line that ends in the hint.
    """
    with pytest.raises(CspaceError) as caught:
        call()
    line, hint = str(caught.value), caught.value.hint
    assert hint and message in line and "\n" not in line, line
    assert line.index(message) + len(message) > line.index(hint), "the hint is not named"
    advised()
