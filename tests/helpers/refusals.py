"""Tables of refused arguments and their messages."""

from collections.abc import Callable
from typing import Any

import pytest

from cspace.errors import CspaceError


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows whose last value, part of a message, is the id."""
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in rows])


def check_followed(call: Callable[[], Any], advised: Callable[[], Any], hint: str) -> None:
    """Check that a call is refused with a hint, and that what the hint advises is accepted."""
    with pytest.raises(CspaceError) as caught:
        call()
    assert hint in caught.value.hint, caught.value
    advised()
