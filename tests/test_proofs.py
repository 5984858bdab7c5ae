"""No answer that is called a proof is false: the soak, on a few maps of each space, by other geometry than ours."""

from functools import partial

import pytest

from benchmarks.report import Report
from benchmarks.soak import maps
from benchmarks.soak.plane_cases import draw_case
from benchmarks.soak.space_cases import draw_solid_case

DRAWN = {
    "robots in the plane": draw_case,
    "robots that turn": partial(draw_case, turning=True),
    "robots in space": draw_solid_case,
}


@pytest.mark.filterwarnings("ignore")  # of obstacles that are tiny, or open, or beyond the bounds
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("name", DRAWN)
def test_states_edges_boxes_clearances_and_walks_are_as_geometry_has_them(name: str, seed: int) -> None:
    """Anywhere, on borders of cells and next to them, outside the grid too; robots and obstacles of every kind."""
    report = Report(quick=True)
    maps.check(report, name, DRAWN[name], seed, 20_000, 20)
    assert not report.failures, report.notes
