"""Maps to save, and what must hold of them once they are read again."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import xarray
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import cspace
from cspace.shapes import Balls
from cspace.errors import FileError
from cspace.io import arrays, geometry, npz, record, store
from cspace.io.reading import open_map
from cspace.io.writing import save
from cspace.rotations import TURN, Rotations
from strategies import robots

SUFFIXES = [".zarr", "", ".npz"]


def same(a: cspace.CSpace, b: cspace.CSpace) -> None:
    """Fail unless two maps are equal, to the last bit."""
    assert a.grid == b.grid
    assert (a.robot.spec, a.robot.name) == (b.robot.spec, b.robot.name)
    assert (a.outside, a.margin, a.precision) == (b.outside, b.margin, b.precision)
    assert a.workspace.source == b.workspace.source
    assert a.rotations == b.rotations
    np.testing.assert_array_equal(a.slice_of, b.slice_of)
    assert bits(a) == bits(b)
    assert list(a.fields) == list(b.fields)
    for old, new in [
        *((a.fields[name], b.fields[name]) for name in a.fields),
        (a.stack, b.stack),
        (a.state, b.state),
        (a.overlaps, b.overlaps),
        (a.workspace.outer, b.workspace.outer),
        (a.workspace.inner, b.workspace.inner),
    ]:
        assert (old is None) == (new is None)
        if old is not None and new is not None:
            assert old.dtype == new.dtype
            np.testing.assert_array_equal(old, new)
    low, high = ([*np.add(corner, by), 9.0 * by] for corner, by in ((a.grid.lower, -1.0), (a.grid.upper, 1.0)))
    q = np.random.default_rng(0).uniform(low[: a.dof], high[: a.dof], (64, a.dof))
    np.testing.assert_array_equal(a.classify(q), b.classify(q))


def bits(space: cspace.CSpace) -> list[Any] | None:
    """The shapes of the obstacles, to the last bit."""
    shapes = space.workspace.shapes
    return None if shapes is None else [_bits(shape) for shape in shapes]


def _bits(shape: Any) -> Any:
    if isinstance(shape, shapely.Geometry):
        return shapely.to_wkb(shape)
    if isinstance(shape, Balls):
        return "balls", shape.centers.tobytes(), shape.radii.tobytes()
    return shape.solid, shape.source, shape.vertices.tobytes(), shape.faces.tobytes()


@st.composite
def rotation_cells(draw: st.DrawFn) -> Rotations:
    """Rotation cells, equal or not."""
    count = draw(st.integers(1, 8))
    if draw(st.booleans()):
        return Rotations.of(count)
    widths = np.array(draw(st.lists(st.floats(0.1, 1.0), min_size=count, max_size=count)))
    first = draw(st.floats(-6.0, 6.0))
    return Rotations.of([first, *(first + np.cumsum(widths)[:-1] / widths.sum() * TURN), first + TURN])


@st.composite
def spaces(draw: st.DrawFn) -> cspace.CSpace:
    """Maps with any content: the files must carry what is there, not what a build would give."""
    shape = draw(st.tuples(st.integers(1, 12), st.integers(1, 12)))
    number = st.floats(-100.0, 100.0)
    grid = cspace.Grid(draw(st.tuples(number, number)), draw(st.floats(0.01, 3.0)), shape)
    outer = draw(hnp.arrays(bool, shape))
    inner = draw(st.one_of(st.just(outer), hnp.arrays(bool, shape).map(lambda cells: cells & outer)))
    robot, rotations = draw(robots(1.5)), draw(st.none() | rotation_cells())
    stack = shape if rotations is None else (int(rotations.slice_of(robot).max()) + 1, *shape)
    shapes = draw(st.none() | st.lists(st.tuples(number, number).map(shapely.Point), max_size=3).map(tuple))
    return cspace.CSpace(
        cspace.Workspace(grid=grid, outer=outer, inner=inner, source=draw(st.text(max_size=9)), shapes=shapes),
        robot,
        draw(hnp.arrays(np.uint8, stack, elements=st.integers(0, 2))),
        outside=draw(st.sampled_from(["blocked", "free"])),
        margin=draw(st.floats(0.0, 2.0)),
        precision=draw(st.sampled_from(["float32", "float64"])),
        overlaps=draw(st.one_of(st.none(), hnp.arrays(np.int32, stack, elements=st.integers(0, 2**31 - 1)))),
        rotations=rotations,
    )


def rebuilt(dataset: xarray.Dataset) -> cspace.CSpace:
    """The map that a Dataset describes, built anew from the workspace and the robot alone."""
    about, borders = dataset.attrs, None
    if about["rotations"]:
        borders = [*dataset.yaw_bounds.values[:, 0], dataset.yaw_bounds.values[-1, 1]]
    return cspace.build(
        cspace.Workspace(
            grid=cspace.Grid(about["lower"], about["spacing"], about["shape"]),
            outer=dataset.outer.values,
            inner=dataset.inner.values,
            source=about["workspace_source"],
            shapes=geometry.shapes_from({str(name): dataset[name].values for name in dataset}),
        ),
        cspace.Robot.from_spec(json.loads(about["robot"])),
        rotations=borders,
        outside=about["outside"],
        margin=about["margin"],
        overlap="overlap" in dataset,
    )


def refused(path: Path, *words: str) -> None:
    """Fail unless opening ``path`` is an error that names it and holds ``words``."""
    with pytest.raises(FileError) as caught:
        open_map(path)
    message = str(caught.value)
    for word in (str(path), *words):
        assert word in message


def files(path: Path) -> Iterator[Path]:
    return (entry for entry in sorted(path.rglob("*")) if entry.is_file())


def forged(path: Path, space: cspace.CSpace, metadata: dict[str, Any], content: dict[str, Any]) -> None:
    """Save what no map is, under digests that agree with it."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (store, npz):
            patch.setattr(module, "metadata_of", lambda space: record.metadata_of(space) | metadata)
            patch.setattr(
                module,
                "arrays_of",
                lambda space: {k: v for k, v in (arrays.arrays_of(space) | content).items() if v is not None},
            )
        save(space, path)


def interrupted(path: Path, space: cspace.CSpace, stop: type[BaseException], earlier: cspace.CSpace | None) -> None:
    """Fail unless a save as a folder may stop at any of its files, and leave the earlier map, or nothing."""
    write = Path.write_bytes
    save(space, path)
    count = len(list(files(path)))
    shutil.rmtree(path)
    if earlier is not None:
        save(earlier, path)
    for limit in range(count):
        written = 0

        def stub(file: Path, content: bytes, limit: int = limit) -> None:
            nonlocal written
            if written == limit:
                write(file, content[: len(content) // 2])
                raise stop
            written += 1
            write(file, content)

        with pytest.MonkeyPatch.context() as patch, pytest.raises(stop):
            patch.setattr(Path, "write_bytes", stub)
            save(space, path, overwrite=True)
        assert list(path.parent.iterdir()) == ([] if earlier is None else [path])
        if earlier is not None:
            same(earlier, open_map(path))
    save(space, path, overwrite=True)
    same(space, open_map(path))
