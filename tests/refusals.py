"""Tables of refusals: one row for each refused argument and part of its message."""

from typing import Any

import pytest


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows; the last value, part of the message, is the id."""
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in rows])
