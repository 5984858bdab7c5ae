"""Costs: how long the engines' steps take on this machine, measured once and kept."""

from __future__ import annotations

import json
import math
import platform
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace.threads import cores

SIZES: Final = tuple(2**k for k in (12, 14, 16, 18, 20, 22))
"""Points of the transforms that are timed."""

_FORMAT: Final = 1

_TIMES: Final = 3
"""How often each step is timed; the shortest counts, since other work on the machine only adds to it."""


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds that steps take in one thread.

    Attributes
    ----------
    float32, float64 : tuple of float
        For each point of a tile of each size in :data:`SIZES`: half of what its transforms, there and back, and all
        that is done with its numbers take.
    tile : float
        For each tile, whatever its size.
    run : float
        For each word of 64 cells and each run of a robot's offsets.
    cell : float
        For each cell of results: into words and out of them.
    """

    float32: tuple[float, ...]
    float64: tuple[float, ...]
    tile: float
    run: float
    cell: float

    def transform(self, size: int, precision: str) -> float:
        """Half of what a tile of so many points takes: one transform and its share of the rest."""
        known = self.float32 if precision == "float32" else self.float64
        place = max(math.log2(size / SIZES[0]) / 2.0, 0.0)
        left = min(int(place), len(SIZES) - 2)
        # Beyond the largest size the cost of a point goes on as it did, but never down: that would be noise.
        slope = known[left + 1] - known[left] if place <= left + 1 else max(0.0, known[left + 1] - known[left])
        return size * (known[left + 1] + slope * (place - left - 1)) + 0.5 * self.tile


TYPICAL: Final = Costs(
    float32=(2.4e-9, 2.5e-9, 2.5e-9, 2.6e-9, 3.0e-9, 4.8e-9),
    float64=(3.4e-9, 3.5e-9, 3.6e-9, 4.0e-9, 5.3e-9, 8.3e-9),
    tile=4e-5,
    run=1.4e-10,
    cell=4.7e-10,
)
"""Measured on two cores of a server; taken until the machine's own are."""


class Figures:
    """The costs of this machine: from the user's cache folder, or measured, or else the typical ones."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self._lock = threading.Lock()
        self._measured = _read(file)

    @property
    def now(self) -> Costs:
        """What is known so far."""
        return self._measured or TYPICAL

    @property
    def are_measured(self) -> bool:
        """Whether they are this machine's own."""
        return self._measured is not None

    def measure(self) -> Costs:
        """Measure them, in about a second, and keep them; a folder that cannot be written to does no harm."""
        with self._lock:
            if self._measured is None:
                self._measured = measured_costs()
                _write(self.file, self._measured)
            return self._measured


@cache
def figures() -> Figures:
    """Those of this process."""
    import platformdirs

    return Figures(platformdirs.user_cache_path("cspace") / "costs.json")


def measured_costs() -> Costs:
    """Time the engines' steps on this machine."""
    transforms = {name: [_transform_seconds(size, name) for size in SIZES] for name in ("float32", "float64")}
    # A tile of one point in 4096 of the smallest size costs next to nothing but its calls.
    tile = 2.0 * _transform_seconds(64, "float32")
    points = {
        name: tuple(max(each - 0.5 * tile, 0.1 * each) / size for each, size in zip(seconds, SIZES, strict=True))
        for name, seconds in transforms.items()
    }
    run, cell = _word_seconds()
    return Costs(points["float32"], points["float64"], tile, run, cell)


def _transform_seconds(size: int, precision: str) -> float:
    """Half of what a square tile takes, from cells to results."""
    from cspace.fourier.tile_run import Part, TileRun
    from cspace.fourier.tiles import Tiling

    side = math.isqrt(size)
    occupied = np.indices((side, side)).sum(axis=0) % 7 == 0
    result = np.empty((side, side), dtype=np.bool_)
    tiling = Tiling((side, side), (side, side), precision, 0.0, 1, 1, 1, 1)
    run = TileRun(occupied, False, tiling, (0, 0), False)
    members = [(Part(np.ones((1, 1), dtype=np.bool_), (0, 0), 1, 0), result)]
    spectrum = run.robot_spectrum(members)
    return 0.5 * _shortest(lambda: run.settle(([(0, 0)], [(members, spectrum)])))


def _word_seconds() -> tuple[float, float]:
    """Seconds for a word and a run, and for a cell of results."""
    from cspace.bits import dilate
    from cspace.raster.raster import Raster

    occupied = np.indices((1024, 1024)).sum(axis=0) % 97 == 0
    out = [np.empty(occupied.shape, dtype=np.bool_)]
    seconds = []
    for runs in (4, 132):
        rasters = [Raster.trimmed(np.ones((runs, 9), dtype=np.bool_), (0, 0))]
        seconds.append(_shortest(partial(dilate, occupied, rasters, outside=False, out=out, workers=1)))
    words = occupied.size / 64
    each = max(seconds[1] - seconds[0], 1e-7) / (128.0 * words)
    return each, max(seconds[0] - 4.0 * words * each, 1e-6) / occupied.size


def _shortest(work: Callable[[], Any]) -> float:
    work()  # compiles, and warms the caches
    times = []
    for _ in range(_TIMES):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def _machine() -> dict[str, Any]:
    """What the costs depend on."""
    packages = {name: version(name) for name in ("cspace", "numpy", "scipy", "numba")}
    return {"node": platform.node(), "machine": platform.machine(), "cores": cores(), **packages}


def _read(file: Path) -> Costs | None:
    """What a file holds for this machine, or None."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        if found["format"] != _FORMAT or found["machine"] != _machine():
            return None
        costs = _checked(found["costs"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return costs


def _checked(values: Mapping[str, Any]) -> Costs:
    """Costs of a file, all of them above zero."""
    rows = [tuple(float(each) for each in values[name]) for name in ("float32", "float64")]
    single = [float(values[name]) for name in ("tile", "run", "cell")]
    every = [*rows[0], *rows[1], *single]
    if len(rows[0]) != len(SIZES) or len(rows[1]) != len(SIZES) or not all(0.0 < each < 1.0 for each in every):
        raise ValueError(f"costs are {values}; they must be seconds above zero, one for each of {len(SIZES)} sizes")
    return Costs(rows[0], rows[1], *single)


def _write(file: Path, costs: Costs) -> None:
    """Keep costs; written to a temporary name first."""
    record = {"format": _FORMAT, "machine": _machine(), "costs": asdict(costs)}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=file.parent, suffix=".tmp", delete=False, encoding="utf-8") as draft:
            json.dump(record, draft, indent=1)
        Path(draft.name).replace(file)
    except OSError:
        return
