"""Tables of refusals: a row each for an argument that is refused and a part of the message."""

from typing import Any

import pytest


def refusals(names: str, *rows: tuple[Any, ...]) -> pytest.MarkDecorator:
    """Parametrize a test by rows whose last value, a part of the message, also names the case."""
    return pytest.mark.parametrize(names, [pytest.param(*row, id=str(row[-1])) for row in rows])
