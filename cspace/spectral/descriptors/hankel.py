"""Fourier transforms of radial functions that vanish beyond the unit ball.

For ``f(|x|)`` and ``k = |w|`` the transform ``integral f(|x|) exp(-2 pi i w.x) dx`` is

    2 pi integral_0^1 f(s) J0(2 pi k s) s ds   in the plane,      4 pi integral_0^1 f(s) sinc(2 k s) s^2 ds   in space

with ``sinc(x) = sin(pi x) / (pi x)``. The integral is a composite Gauss-Legendre rule: panels are halved until each
holds ``f(s) s^(dim - 1)`` as a polynomial of two thirds of the degree that the nodes resolve, which grades them towards
a cusp at 0 and a steep flank near 1, and then cut evenly until the kernel turns by less than :data:`PHASE` in each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Radial = Callable[[Floats], Floats]

NODES: Final = 32
"""Gauss-Legendre nodes in a panel."""

RESOLVED: Final = 20
"""Legendre coefficients of a panel from this one on must be negligible; the rest of the rule's degree, 43, is left to
the kernel."""

PHASE: Final = 20.0
"""Radians by which the kernel may turn in a panel: from 43 on, the Legendre coefficients of exp(10 i x) are below
1e-17."""

NEGLIGIBLE: Final = 1e-2
"""Part of the tolerance that all unresolved coefficients together may take."""

MOST_HALVINGS: Final = 200

CHUNK: Final = 2**21
"""Kernel values held at once."""


def legendre_rule(count: int) -> tuple[Floats, Floats]:
    """Nodes and weights on [-1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return np.asarray(nodes), np.asarray(weights)


class RadialTransform:
    """The transform of one radial function.

    Parameters
    ----------
    function : callable
        Values at ``s`` in (0, 1), not below zero; smooth but for 0 and 1.
    dim : int
        2 or 3.
    tolerance : float
        Of the transform, relative to its value at 0, which is the largest.
    """

    def __init__(self, function: Radial, dim: int, tolerance: float) -> None:
        self._function, self._dim = function, dim
        self._panels = self._graded(tolerance)

    def __call__(self, frequencies: Floats) -> Floats:
        """The transform at ``k``, none below zero, of any shape."""
        flat = frequencies.ravel()
        order = np.argsort(flat)
        result = np.empty(flat.shape)
        start = 0
        while start < len(flat):
            # What turns at most twice as fast shares a rule.
            first = max(1.0, float(flat[order[start]]))
            stop = int(np.searchsorted(flat, 2.0 * first, side="right", sorter=order))
            part = order[start:stop]
            result[part] = self._band(flat[part])
            start = stop
        return result.reshape(frequencies.shape)

    def _band(self, frequencies: Floats) -> Floats:
        nodes, weights = self._rule(float(frequencies.max()))
        step = max(1, CHUNK // len(nodes))
        chunks = [frequencies[i : i + step] for i in range(0, len(frequencies), step)]
        return np.concatenate([self._kernel(chunk[:, None] * nodes) @ weights for chunk in chunks])

    def _kernel(self, product: Floats) -> Floats:
        if self._dim == 3:
            return np.asarray(np.sinc(2.0 * product))
        from scipy.special import j0

        return np.asarray(j0(2.0 * math.pi * product))

    def _rule(self, most: float) -> tuple[Floats, Floats]:
        """Nodes, and weights times the function, for frequencies up to ``most``."""
        lows, highs = self._panels
        parts = np.maximum(1, np.ceil(2.0 * math.pi * most * (highs - lows) / PHASE)).astype(np.int64)
        widths = np.repeat((highs - lows) / parts, parts)
        number = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
        nodes, weights = legendre_rule(NODES)
        s = (np.repeat(lows, parts) + widths * number)[:, None] + widths[:, None] * (0.5 + 0.5 * nodes)
        measure = 2.0 * math.pi * s if self._dim == 2 else 4.0 * math.pi * s * s
        return s.ravel(), (0.5 * widths[:, None] * weights * measure * self._function(s)).ravel()

    def _graded(self, tolerance: float) -> tuple[Floats, Floats]:
        """Lower and upper ends of panels that resolve the function."""
        nodes, weights = legendre_rule(NODES)
        degrees = np.arange(NODES)
        to_coefficients = np.polynomial.legendre.legvander(nodes, NODES - 1).T * weights * (degrees[:, None] + 0.5)
        lows, highs = np.array([0.0]), np.array([1.0])
        done: list[tuple[Floats, Floats]] = []
        settled = 0.0
        for _ in range(MOST_HALVINGS):
            widths = highs - lows
            s = lows[:, None] + widths[:, None] * (0.5 + 0.5 * nodes)
            values = self._function(s) * s ** (self._dim - 1)
            masses = 0.5 * widths * (values @ weights)
            tails = widths * np.abs(values @ to_coefficients.T)[:, RESOLVED:].sum(axis=1)
            rough = tails > NEGLIGIBLE * tolerance * (settled + masses.sum())
            settled += float(masses[~rough].sum())
            done.append((lows[~rough], highs[~rough]))
            if not rough.any():
                break
            lows, highs = lows[rough], highs[rough]
            middles = 0.5 * (lows + highs)
            lows, highs = np.concatenate([lows, middles]), np.concatenate([middles, highs])
        return np.concatenate([low for low, _ in done]), np.concatenate([high for _, high in done])
