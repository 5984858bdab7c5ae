"""Maps read while they are replaced."""

import numpy as np
import pytest

from tests.fuzz.use import kill_saves


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of forks beside threads
def test_a_saved_map_that_is_replaced_opens_whole_or_not_at_all():
    counts = kill_saves(3, np.random.default_rng(0))
    assert counts["whole"] > 0 and set(counts) <= {"whole", "refused", "absent"}
