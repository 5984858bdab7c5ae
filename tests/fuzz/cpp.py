"""The C++ header against Python, on many configurations, and on damaged files, with sanitizers."""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING
from unittest.mock import patch

import numpy as np

import cspace
from tests.fuzz.files import mutate, reseal
from tests.helpers.cpp import (
    SANITIZERS,
    SPACES,
    build_program,
    build_space,
    count_differences,
    draw_queries,
    open_in_cpp,
    why_no_compiler,
)

if TYPE_CHECKING:
    from benchmarks.report import Report

STATES, MOTIONS = 1_000_000, 100_000
"""Numbers of states of each space, and of states and motions in one call."""

DAMAGED = 300
"""Number of damaged maps, half of them with a digest that agrees."""

FAST_FLAGS = ("-O3", "-march=native")
"""Flags with which compilers contract to fused multiply-adds, unless the header forbids it."""


def build_tiles(name: str, outside: str, folder: Path) -> cspace.CSpace:
    """Build a map in tiles; return the same map in memory."""
    space = build_space(name, outside)
    tile = 20 if space.dim == 2 else 8
    cspace.build(
        space.workspace,
        space.robot,
        rotations=space.rotations,
        outside=outside,
        store=folder,
        tile=tile,
    )
    return space


def write_damaged(
    path: Path, folder: Path, number: int, rng: np.random.Generator, forged: bool = False
) -> list[Path]:
    """Write copies of a map with one file changed, cut or lost; with ``forged``, the digest agrees."""
    files = sorted(file.relative_to(path) for file in path.rglob("*") if file.is_file())
    folder.mkdir(exist_ok=True)
    copies = []
    for k in range(number):
        copy = folder / f"{'forged' if forged else 'damaged'}{k}"
        shutil.copytree(path, copy)
        # Metadata and small arrays are as likely as the states.
        file = copy / files[rng.integers(len(files))]
        content = file.read_bytes()
        changed = mutate(content, (path / files[rng.integers(len(files))]).read_bytes(), rng)
        if changed == content:
            changed = content[:-1]
        file.write_bytes(changed)
        if not forged and rng.random() < 0.1:
            file.unlink()
        if forged and file.name == "zarr.json":
            _reseal_if_possible(copy)
        elif forged:
            reseal(copy)
        copies.append(copy)
    return copies


def _reseal_if_possible(path: Path) -> None:
    """Write a valid digest unless the attributes are no JSON any more."""
    try:
        reseal(path)
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError, OSError):
        return


def check(report: Report, seed: int) -> None:
    """Compare answers in every space, in memory and in tiles; open damaged maps."""
    if why_no_compiler():
        report.note(f"skipped: {why_no_compiler()}")
        return
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        careful = build_program(
            folder / "careful", "-O1", "-g", "-fno-sanitize-recover=all", *SANITIZERS
        )
        fast = build_program(folder / "fast", *FAST_FLAGS)
        report.section(f"C++ against Python, seed {seed}")
        for space_name in SPACES:
            for outside in ("blocked", "free"):
                _check_space(report, space_name, outside, folder, careful, fast, rng)
        for tiled in ("R2", "SE2 shared", "R3 yaw"):
            space = build_tiles(tiled, "free", folder / f"tiles {tiled}")
            queries = draw_queries(space, MOTIONS, rng)
            found = count_differences(space, careful, folder / f"tiles {tiled}", queries)
            _report_differences(report, f"{tiled} in tiles", found)
        _check_damaged(report, folder, careful, rng)
        _check_chunks(report, folder, rng)
        _check_without_zstd(report, folder)


def _check_space(
    report: Report,
    name: str,
    outside: str,
    folder: Path,
    careful: Path,
    fast: Path,
    rng: np.random.Generator,
) -> None:
    """Compare a map: with the fastest code, and fewer queries with the sanitizers."""
    space = build_space(name, outside)
    path = folder / f"{name} {outside}"
    space.save(path, compress=outside == "free", clearance=True)
    total = Counter[str]()
    for _ in range(STATES // MOTIONS // 2):
        queries = draw_queries(space, MOTIONS, rng)
        total.update(count_differences(space, fast, path, queries))
    _report_differences(report, f"{name}, {outside}", total)
    found = count_differences(space, careful, path, queries[:20_000])
    _report_differences(report, f"{name}, {outside}, sanitized", found)


def _report_differences(report: Report, case: str, found: dict[str, int]) -> None:
    free = found.pop("motions that are free")
    wrong = {kind: number for kind, number in found.items() if number}
    report.check(not wrong, f"{case}: equal answers, {free} free motions {wrong or ''}")


def _check_damaged(report: Report, folder: Path, program: Path, rng: np.random.Generator) -> None:
    """Open damaged maps: refused, or with a valid digest also opened, and no crash."""
    path = folder / "SE2 shared free"
    damaged = write_damaged(path, folder / "damaged", DAMAGED // 2, rng)
    answers = open_in_cpp(program, *damaged)
    wrong = [text for map_, text in zip(damaged, answers, strict=True) if str(map_) not in text]
    report.check(not wrong, f"{len(damaged)} damaged maps are refused {wrong[:3]}")
    forged = write_damaged(path, folder / "damaged", DAMAGED // 2, rng, forged=True)
    answers = open_in_cpp(program, *forged)
    opened = sum(text == "opened" for text in answers)
    named = all(
        str(map_) in text or text == "opened" for map_, text in zip(forged, answers, strict=True)
    )
    report.check(named, f"{len(forged)} forged maps are refused or, {opened} of them, open")


def _check_chunks(report: Report, folder: Path, rng: np.random.Generator) -> None:
    """Compare maps in chunks of several slices, of a part of a slice, and of a row."""
    space = build_space("R3 yaw", "free")
    queries = draw_queries(space, 20_000, rng)
    header = folder / "include" / "cspace" / "map.hpp"
    shutil.copytree(cspace.get_include(), folder / "include")
    text = header.read_text(encoding="utf-8")
    for size in (20_000, 1000, 50):
        header.write_text(text.replace("= 1 << 24", f"= {size}"), encoding="utf-8")
        program = build_program(
            folder / "small", "-O1", *SANITIZERS, "-I", str(header.parent.parent), own=False
        )
        with patch("cspace._files.zarr_folders.WRITTEN_CHUNK_BYTES", size):
            space.save(folder / "chunks", clearance=size > 50, overwrite=True)
        found = count_differences(space, program, folder / "chunks", queries)
        _report_differences(report, f"chunks of {size} bytes", found)


def _check_without_zstd(report: Report, folder: Path) -> None:
    program = build_program(folder / "plain", "-O0", zstd=False)
    space = build_space("R2", "free")
    space.save(folder / "packed")
    space.save(folder / "raw", compress=False)
    packed, raw = open_in_cpp(program, folder / "packed", folder / "raw")
    report.check("define CSPACE_ZSTD" in packed, f"without zstd, compressed maps: {packed}")
    report.check(raw == "opened", f"without zstd, raw maps: {raw}")
