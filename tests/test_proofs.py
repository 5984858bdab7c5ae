"""Proofs of random maps, compared with independent geometry."""

import pytest

from benchmarks.report import Report
from tests.fuzz import maps
from tests.fuzz.scenes import SPACES
from tests.helpers.strategies import few

pytestmark = pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # tiny or distant obstacles


@pytest.mark.parametrize("rounds", few([1, 4]))
@pytest.mark.parametrize("name", SPACES)
def test_proofs_of_random_maps_agree_with_independent_geometry(name, rounds):
    report = Report(quick=True)
    share = maps.SHARES.get(name, 1)
    maps.check_maps(report, name, 1, 2_250 * rounds // share, max(3 * rounds // share, 1))
    maps.check_exact_maps(report, name, 2, 15 * rounds // share)
    assert not report.failures, report.notes
