"""Tables of refused calls, their messages, and the calls as mended."""

from collections.abc import Callable
from typing import Any

import pytest

from cspace.errors import CspaceError


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows whose last value, part of a message, is the id.

    Before it is the mended call, which rows without advice leave out; it is None then.
    """
    count = len(names.split(","))
    full = [row if len(row) == count else (*row[:-1], None, row[-1]) for row in rows]
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in full])


def check_followed(
    call: Callable[[], Any], advised: Callable[[], Any] | None, message: str
) -> None:
    """Check that a call is refused in one line, and that the mended call is accepted, if any.

    ``message`` is a part of the line, which reaches into the hint if a mended call follows it.
    """
    with pytest.raises(CspaceError) as caught:
        call()
    line, hint = str(caught.value), caught.value.hint
    assert message in line and "\n" not in line, line
    if advised is not None:
        assert hint and line.index(message) + len(message) > line.index(hint), "no hint is named"
        advised()
