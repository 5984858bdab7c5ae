"""Proofs of random maps, compared with independent geometry."""

import pytest

from benchmarks.report import Report
from tests.fuzz import maps
from tests.fuzz.scenes import SPACES

pytestmark = pytest.mark.filterwarnings("ignore::cspace.UnitWarning")  # tiny or distant obstacles


@pytest.mark.parametrize("name", SPACES)
def test_proofs_of_random_maps_agree_with_independent_geometry(name):
    report = Report(quick=True)
    share = maps.SHARES.get(name, 1)
    maps.check_maps(report, name, 1, 9_000 // share, 12 // share)
    maps.check_exact_maps(report, name, 2, 60 // share)
    assert not report.failures, report.notes
