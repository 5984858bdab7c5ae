"""Proofs of random maps, compared with independent geometry."""

import pytest

from benchmarks.report import Report
from tests.soak import maps
from tests.soak.scenes import SPACES

pytestmark = pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # tiny or distant obstacles


@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", SPACES)
def test_proofs_of_random_maps_agree_with_independent_geometry(name, seed):
    report = Report(quick=True)
    share = maps.SHARES.get(name, 1)
    maps.check_maps(report, name, seed, 9_000 // share, 12 // share)
    assert not report.failures, report.notes


@pytest.mark.parametrize("seed", range(1, 3))
@pytest.mark.parametrize("name", SPACES)
def test_exact_queries_of_random_maps_agree_with_independent_geometry(name, seed):
    report = Report(quick=True)
    maps.check_exact_maps(report, name, seed, 60 // maps.SHARES.get(name, 1))
    assert not report.failures, report.notes
