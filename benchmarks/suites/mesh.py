"""Rasterization of a mesh of 100,000 triangles into 256^3 cells, against trimesh."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from benchmarks.report import Report
from benchmarks.timing import interleave, memory_rise, once
from cspace import Workspace
from cspace._shapes.mesh import Mesh
from cspace._support.arrays import Bools, Floats, Ints

TORUS_POINTS = (250, 200)
"""Points along the two circles of a torus, which has two triangles a point."""

CELLS_PER_SIDE = 256
MAX_SECONDS = 2.0
"""Target, seconds."""

UNIT_BOUNDS = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)


def run(report: Report, seed: int) -> None:
    """Rasterise a bumpy torus as a surface and as a solid."""
    rng = np.random.default_rng(seed)
    around, cells, runs = ((50, 40), 64, 3) if report.quick else (TORUS_POINTS, CELLS_PER_SIDE, 5)
    vertices, faces = _torus(*around, rng)
    spacing = 1.0 / cells
    report.section(f"bumpy torus of {len(faces)} triangles, {' x '.join([str(cells)] * 3)} cells")
    calls: dict[str, Callable[[], Any]] = {
        "ours, solid: touched and inside": partial(_ours, vertices, faces, spacing, "auto"),
        "ours, surface: touched": partial(_ours, vertices, faces, spacing, "surface"),
    }
    for call in calls.values():
        call()  # compiles
    risen = {name: memory_rise(call) for name, call in calls.items()}
    timings = interleave(calls, runs)
    # trimesh caches results in a mesh, so each run needs a new mesh. It is slow and runs once.
    peers = {
        "trimesh voxelized": once(partial(_trimesh, vertices, faces, spacing, False)),
        "trimesh voxelized and fill": once(partial(_trimesh, vertices, faces, spacing, True)),
    }
    for name, timing in {**timings, **peers}.items():
        rise = risen.get(name)
        report.timing(
            name, timing, **({} if rise is None else {"peak_memory": f"+{rise / 2**20:.0f} MB"})
        )
    solid, surface = timings.values()
    report.figure("ours, solid", solid.median, "s", most=MAX_SECONDS)
    report.ratio("trimesh voxelized / ours, surface", peers["trimesh voxelized"], surface)
    report.ratio(
        "trimesh voxelized and fill / ours, solid", peers["trimesh voxelized and fill"], solid
    )
    _compare(report, "surface", surface.value.outer, peers["trimesh voxelized"].value)
    _compare(report, "solid", solid.value.outer, peers["trimesh voxelized and fill"].value)
    inner = solid.value.inner
    report.check(
        not (inner & surface.value.outer).any(), f"none of {inner.sum()} inner cells is touched"
    )
    report.check(
        bool((solid.value.outer == (inner | surface.value.outer)).all()),
        "every outer cell is touched or inside",
    )
    volume = Mesh(vertices, faces).volume
    low, high = inner.sum() * spacing**3, solid.value.outer.sum() * spacing**3
    report.check(
        low < volume < high,
        f"volume {volume:.5g} lies between that of the cells, {low:.5g} and {high:.5g}",
    )


def _compare(report: Report, name: str, ours: Bools, theirs: Bools) -> None:
    extra = int((theirs & ~ours).sum())
    report.check(
        not extra, f"{name}: {theirs.sum()} cells that trimesh marks, {extra} of them not ours"
    )
    missed = int((ours & ~theirs).sum())
    report.note(
        f"{name}: {ours.sum()} cells are ours; trimesh misses {missed} of them, {missed / ours.sum():.1%}"
    )


def _torus(around: int, across: int, rng: np.random.Generator) -> tuple[Floats, Ints]:
    """Return a torus with bumps, a little smaller than the unit cube."""
    u, v = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, around, endpoint=False),
        np.linspace(0.0, 2.0 * np.pi, across, endpoint=False),
        indexing="ij",
    )
    phases = rng.uniform(0.0, 2.0 * np.pi, 4)
    tube = 0.45 + 0.05 * np.sin(7 * u + phases[0]) * np.sin(5 * v + phases[1])
    tube += 0.02 * np.sin(23 * u + phases[2]) * np.sin(17 * v + phases[3])
    far = 1.0 + tube * np.cos(v)
    vertices = np.stack([far * np.cos(u), far * np.sin(u), tube * np.sin(v)], axis=-1).reshape(
        -1, 3
    )
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = 0.001 + 0.998 * (vertices - low) / (high - low)
    numbers = np.arange(around * across).reshape(around, across)
    right, up = np.roll(numbers, -1, axis=0), np.roll(numbers, -1, axis=1)
    both = np.roll(right, -1, axis=1)
    faces = np.concatenate(
        [np.stack([numbers, right, both], axis=-1), np.stack([numbers, both, up], axis=-1)]
    )
    return vertices, faces.reshape(-1, 3)


def _ours(vertices: Floats, faces: Ints, spacing: float, solid: str) -> Workspace:
    return Workspace.from_mesh((vertices, faces), spacing, UNIT_BOUNDS, solid=solid)  # type: ignore[arg-type]


def _trimesh(vertices: Floats, faces: Ints, spacing: float, fill: bool) -> Bools:
    """Return the cells that trimesh marks, on our grid."""
    import trimesh

    # trimesh has cell centers, and we have cell corners, at multiples of the spacing.
    mesh = trimesh.Trimesh(vertices - 0.5 * spacing, faces, process=False)
    voxels = mesh.voxelized(spacing)
    voxels = voxels.fill() if fill else voxels
    cells = np.zeros((round(1.0 / spacing),) * 3, dtype=np.bool_)
    cells[tuple(np.round(np.asarray(voxels.points) / spacing).astype(np.int64).T)] = True
    return cells
