"""Spectra of balls, against direct sums."""

import itertools
import math
import os
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspace.spectral import Bump, FourierOverlap, ball_spectrum
from tests.helpers.strategies import examples, seeds

finufft = pytest.importorskip("finufft")


def sum_directly(centers, radii, bump, frequencies):
    """Sum the terms of all balls at frequencies (n, d)."""
    dim = centers.shape[1]
    moduli = np.linalg.norm(frequencies, axis=1)
    sizes, group = np.unique(radii, return_inverse=True)
    radial = sizes**dim * bump.radial_spectrum(np.outer(moduli, sizes), dim)
    waves = np.exp(-2j * math.pi * (frequencies @ centers.T))
    return (radial[:, group] * waves).sum(axis=1)


def draw_frequencies(rng, lengths, counts):
    """Draw indices into a spectrum, corners and middles included, and their frequencies."""
    borders = itertools.product(*((0, m // 2, (m - 1) // 2, m - 1) for m in counts))
    indices = np.vstack([rng.integers(0, counts, (20, len(counts))), list(borders)]).T
    k = [np.fft.fftfreq(m, 1.0 / m)[column] for m, column in zip(counts, indices, strict=True)]
    return tuple(indices), np.transpose(k) / lengths


@examples(6)
@given(
    st.sampled_from([2, 3]),
    seeds,
    st.sampled_from([Bump(2.0), Bump(math.inf)]),
    st.sampled_from([1e-6, 1e-12]),
)
@pytest.mark.parametrize(
    "number, radius_count",
    [(30, 2), (400, 2), (110, 110), (500, 500)],
    ids=["products", "transforms", "few radii", "many radii"],
)
def test_ball_spectrum_agrees_with_the_direct_sum(number, radius_count, dim, seed, bump, tolerance):
    rng = np.random.default_rng(seed)
    radii = rng.choice(rng.uniform(0.02, 0.3, radius_count), number)
    centers = rng.uniform(-1.0, 1.0, (number, dim)) + rng.uniform(-9.0, 9.0, dim)
    counts = tuple(rng.integers(8, {2: 60, 3: 20}[dim], dim).tolist())
    lengths = rng.uniform(2.7, 4.0, dim)
    spectrum = ball_spectrum(centers, radii, bump, lengths, counts, tolerance)
    assert spectrum.shape == counts
    indices, frequencies = draw_frequencies(rng, lengths, counts)
    expected = sum_directly(centers, radii, bump, frequencies)
    largest = bump.radial_spectrum(0.0, dim) * (radii**dim).sum()
    assert np.abs(spectrum[indices] - expected).max() <= tolerance * largest
    assert spectrum.flat[0] == pytest.approx(largest, rel=tolerance)


@pytest.mark.parametrize("dim", [2, 3])
def test_transforms_neither_warn_nor_print(dim, capfd):
    rng = np.random.default_rng(1)
    sets = [(rng.random((200, dim)).astype(np.float32), np.full(200, 0.05)) for _ in range(2)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for tolerance in (1e-12, 1e-6, 0.1):
            for count in (1, 20):
                ball_spectrum(*sets[0], Bump(2.0), 3.0, count, tolerance)
        if dim == 2:
            overlap = FourierOverlap(*sets, tolerance=0.1)
            overlap.value_and_gradient(np.asfortranarray(rng.uniform(-1.0, 1.0, (300, 2))))
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="POSIX")
def test_transforms_in_a_forked_process_take_one_thread(monkeypatch):
    taken = []

    def transform(*arrays, nthreads, **options):
        taken.append(nthreads)
        return np.zeros(arrays[-1])

    monkeypatch.setattr(finufft, "nufft2d1", transform)
    monkeypatch.setattr("cspace.spectral._spectra.count_cores", lambda: 8)
    centers = np.random.default_rng(1).random((100, 2))
    ball_spectrum(centers, 0.05, Bump(2.0), 3.0, 512)
    child = os.fork()
    if not child:
        ball_spectrum(centers, 0.05, Bump(2.0), 3.0, 512)
        os._exit(taken[-1])
    assert taken == [8] and os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 1
