"""Proofs of random maps, compared with independent geometry."""

import pytest

from benchmarks.report import Report
from tests.soak import maps


@pytest.mark.filterwarnings("ignore")  # warnings about tiny, open or distant obstacles
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", list(maps.SPACE_CASES)[:3])
def test_proofs_of_random_maps_agree_with_independent_geometry(name: str, seed: int) -> None:
    # Configurations lie inside cells, on and next to boundaries, and outside the grid.
    report = Report(quick=True)
    maps.check_maps(report, name, maps.SPACE_CASES[name][0], seed, 20_000, 20)
    assert not report.failures, report.notes
