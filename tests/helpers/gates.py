"""Proofs of chunks by gates without further limits."""

from cspace import Gate


def certify_chunk(space, q, rows, tracking=0.0, **limits):
    """Return the proof of rows, or of a batch of chunks."""
    return Gate(space, tracking=tracking, **limits).check_rows(q, rows).chunk


def certify_twists(space, q, twists, dt, tracking=0.0, **limits):
    """Return the proof of twists, or of a batch of chunks."""
    return Gate(space, tracking=tracking, dt=dt, **limits).check_twists(q, twists).chunk
