"""Unaligned words in arrays of bytes."""

import numpy as np
from numba import njit

from cspace.kernels import load_word, store_word


@njit
def swap_words(octets, first, second):
    """Exchange two words."""
    word = load_word(octets, first)
    store_word(octets, first, load_word(octets, second))
    store_word(octets, second, word)


def test_unaligned_words_are_read_and_written():
    octets = np.random.default_rng(0).integers(0, 256, 40).astype(np.uint8)
    expected = octets.copy()
    expected[3:11], expected[21:29] = octets[21:29], octets[3:11]
    swap_words(octets, 3, 21)
    np.testing.assert_array_equal(octets, expected)
