"""Maps to save, and what must hold of them once they are read again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import cspace
from cspace.errors import FileError
from cspace.io.files import open_map
from strategies import robots

SUFFIXES = [".zarr", "", ".npz"]


def same(a: cspace.CSpace, b: cspace.CSpace) -> None:
    """Fail unless two maps are equal, to the last bit."""
    assert a.grid == b.grid
    assert (a.robot.spec, a.robot.name) == (b.robot.spec, b.robot.name)
    assert (a.outside, a.margin, a.precision) == (b.outside, b.margin, b.precision)
    assert a.workspace.source == b.workspace.source
    for old, new in [
        (a.state, b.state),
        (a.overlaps, b.overlaps),
        (a.workspace.outer, b.workspace.outer),
        (a.workspace.inner, b.workspace.inner),
    ]:
        assert (old is None) == (new is None)
        if old is not None and new is not None:
            assert old.dtype == new.dtype
            np.testing.assert_array_equal(old, new)
    q = np.random.default_rng(0).uniform(np.subtract(a.grid.lower, 1.0), np.add(a.grid.upper, 1.0), (64, a.grid.dim))
    np.testing.assert_array_equal(a.classify(q), b.classify(q))


@st.composite
def spaces(draw: st.DrawFn) -> cspace.CSpace:
    """Maps with any content: the files must carry what is there, not what a build would give."""
    shape = draw(st.tuples(st.integers(1, 12), st.integers(1, 12)))
    number = st.floats(-100.0, 100.0)
    grid = cspace.Grid(draw(st.tuples(number, number)), draw(st.floats(0.01, 3.0)), shape)
    outer = draw(arrays(bool, shape))
    inner = draw(st.one_of(st.just(outer), arrays(bool, shape).map(lambda cells: cells & outer)))
    return cspace.CSpace(
        cspace.Workspace(grid=grid, outer=outer, inner=inner, source=draw(st.text(max_size=9))),
        draw(robots(1.5)),
        draw(arrays(np.uint8, shape, elements=st.integers(0, 2))),
        outside=draw(st.sampled_from(["blocked", "free"])),
        margin=draw(st.floats(0.0, 2.0)),
        precision=draw(st.sampled_from(["float32", "float64"])),
        overlaps=draw(st.one_of(st.none(), arrays(np.int32, shape, elements=st.integers(0, 2**31 - 1)))),
    )


def refused(path: Path, *words: str) -> None:
    """Fail unless opening ``path`` is an error that names it and holds ``words``."""
    with pytest.raises(FileError) as caught:
        open_map(path)
    message = str(caught.value)
    for word in (str(path), *words):
        assert word in message
