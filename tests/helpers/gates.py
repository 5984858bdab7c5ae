"""Proofs of chunks by gates without further limits."""

from cspace import Gate


def certify_chunk(space, q, rows, tracking=0.0, **limits):
    """Return the proof of rows, or of a batch of chunks."""
    return Gate(space, tracking=tracking, **limits).check_rows(q, rows).chunk


def certify_twists(space, q, twists, dt, tracking=0.0, **limits):
    """Return the proof of twists, or of a batch of chunks."""
    return Gate(space, tracking=tracking, dt=dt, **limits).check_twists(q, twists).chunk


def draw_instants(points, tracking, rng, count):
    """Draw configurations within tubes through points, many of them in corners."""
    first = rng.integers(0, len(points) - 1, count)
    exact = points[first] + rng.random((count, 1)) * (points[first + 1] - points[first])
    return exact + tracking * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], exact.shape)
