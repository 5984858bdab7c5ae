"""Triangles that provably cross, against rational arithmetic."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cspace._bodies.crossings import crosses
from cspace.inside import kernel
from tests.helpers.strategies import examples, seeds
from tests.helpers.triangles import squared_triangle_distance, triangle_pairs


@kernel
def cross_pairs(pairs, required, displacement, out):
    """Test which triangles (n, 2, 3, 3) are proven to cross, also after a displacement."""
    for n in range(len(pairs)):
        a = pairs[n, 0]
        b = pairs[n, 1]
        one = (a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2])
        two = (b[0, 0], b[0, 1], b[0, 2]), (b[1, 0], b[1, 1], b[1, 2]), (b[2, 0], b[2, 1], b[2, 2])
        out[n] = crosses(one, two, required, displacement)


@examples(150)
@given(triangle_pairs(), seeds, st.sampled_from([1e-12, 1e-3]))
def test_crosses_is_right_for_any_rounding(pair, seed, required):
    """Move the corners about as far as the rounding may be, then by less."""
    rng = np.random.default_rng(seed)
    away = required * 10.0 ** rng.uniform(-1.0, 3.0, (40, 1, 1, 1))
    pairs = np.stack(pair) + away * rng.normal(size=(40, 2, 3, 3))
    crossing = np.empty(40, dtype=np.bool_)
    cross_pairs(pairs, required, 0.0, crossing)
    off = rng.normal(size=pairs.shape)
    off *= 0.25 * required / np.linalg.norm(off, axis=-1, keepdims=True)
    for placed in (*pairs[crossing][:4], *(pairs + off)[crossing][:4]):
        assert not squared_triangle_distance(*placed)


@given(seed=seeds, displacement=st.floats(1e-3, 0.5), flat=st.booleans())
@examples(15)
def test_displaced_triangles_still_cross(seed, displacement, flat):
    """Move one of two triangles, also flat ones, by the largest displacements, in directions that
    separate them."""
    rng = np.random.default_rng(seed)
    pairs = rng.normal(size=(400, 2, 3, 3)) * 10.0 ** rng.uniform(-0.5, 0.5, (400, 2, 1, 1))
    if flat:
        pairs[:, 0, 2] = pairs[:, 0, :2].mean(axis=1) + 0.1 * rng.normal(size=(400, 3))
    crossing = np.empty(400, dtype=np.bool_)
    still = np.empty(400, dtype=np.bool_)
    cross_pairs(pairs, 1e-12, 0.0, crossing)
    cross_pairs(pairs, 1e-12, displacement, still)
    assert not (still & ~crossing).any()
    assert flat or all(squared_triangle_distance(*pair) > 0 for pair in pairs[~crossing][:15])
    for pair in pairs[still][:15]:
        for direction in (*np.eye(3), *rng.normal(size=(4, 3))):
            whole = np.tile(direction, (3, 1)) if rng.random() < 0.7 else rng.normal(size=(3, 3))
            shift = displacement * whole / np.linalg.norm(whole, axis=1, keepdims=True)
            for moved in (0, 1):
                for sign in (-1.0, 1.0):
                    placed = pair.copy()
                    placed[moved] += sign * shift
                    assert not squared_triangle_distance(*placed)
