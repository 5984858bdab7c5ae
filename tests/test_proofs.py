"""No answer that is called a proof is false, by geometry that shares no code with the library, on a few random maps."""

import pytest

from benchmarks.report import Report
from tests.soak import maps


@pytest.mark.filterwarnings("ignore")  # of obstacles that are tiny, or open, or beyond the bounds
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", list(maps.SPACES)[:3])
def test_states_edges_boxes_clearances_and_walks_are_as_geometry_has_them(name: str, seed: int) -> None:
    """Test anywhere, on borders of cells and next to them, outside the grid too; all kinds of robots and obstacles."""
    report = Report(quick=True)
    maps.check_maps(report, name, maps.SPACES[name][0], seed, 20_000, 20)
    assert not report.failures, report.notes
