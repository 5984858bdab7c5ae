"""Tables of refused arguments and their messages."""

from typing import Any

import pytest


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows whose last value, part of a message, is the id."""
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in rows])
