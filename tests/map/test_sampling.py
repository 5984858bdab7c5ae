import numpy as np
import pytest

import cspace
from cspace import FREE, ConfigurationError, InputError, Robot, Workspace


@pytest.fixture(scope="module")
def space():
    occupied = np.zeros((12, 10), dtype=bool)
    occupied[6, 2:] = True
    return cspace.build(Workspace.from_array(occupied, 0.3, (-4.0, 7.0)), Robot.disc(0.2))


def test_samples_are_free_and_repeat_with_the_seed(space):
    samples = space.sample_free(5000, np.random.default_rng(0))
    assert samples.shape == (5000, 2) and space.is_free(samples).all()
    assert (samples == space.sample_free(5000, np.random.default_rng(0))).all()
    assert space.sample_free(rng=np.random.default_rng(0)).shape == (2,)
    assert space.sample_free(0, np.random.default_rng(0)).shape == (0, 2)


def test_samples_are_uniform_over_the_free_area(space):
    """Chi-squared over the FREE cells and over quarters of a cell; six standard deviations."""
    n = 200_000
    samples = space.sample_free(n, np.random.default_rng(1))
    cells = space.grid.cell_of(samples)
    within = (samples - space.grid.lower) / space.grid.spacing - cells
    quarter = (within >= 0.5) @ [2, 1]
    bins = np.bincount(np.ravel_multi_index(cells.T, space.grid.shape) * 4 + quarter, minlength=space.state.size * 4)
    free = np.repeat(space.state.ravel() == FREE, 4)
    assert not bins[~free].any()
    expected, freedom = n / free.sum(), free.sum() - 1
    statistic = np.square(bins[free] - expected).sum() / expected
    assert abs(statistic - freedom) < 6 * np.sqrt(2 * freedom)


def test_nearest_free_is_the_nearest(space):
    rng = np.random.default_rng(2)
    free = space.grid.center_of(np.argwhere(space.state == FREE))
    for q in rng.uniform(-6, 12, (50, 2)):
        nearest = space.nearest_free(q)
        assert space.is_free(nearest)
        assert np.hypot(*(nearest - q)) == pytest.approx(np.hypot(*(free - q).T).min())


def test_nothing_free_is_an_error_that_says_so():
    full = cspace.build(Workspace.from_array(np.ones((3, 3), bool), 0.1), Robot.disc(0.1))
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        full.sample_free(1, np.random.default_rng(0))
    with pytest.raises(ConfigurationError, match="no FREE cell"):
        full.nearest_free((0.0, 0.0))


@pytest.mark.parametrize(("n", "rng", "words"), [(3, None, "rng is None"), (3, 42, "rng is 42"), (-1, None, "rng")])
def test_refuses_other_sources(space, n, rng, words):
    with pytest.raises(InputError, match=words):
        space.sample_free(n, rng)


@pytest.mark.parametrize("n", [-1, 2.5, "many"])
def test_refuses_other_counts(space, n):
    with pytest.raises(InputError, match="n is"):
        space.sample_free(n, np.random.default_rng(0))
