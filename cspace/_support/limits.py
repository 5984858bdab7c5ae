"""Limits of files and of memory, checked before any work.

A file of a few bytes can declare a map of terabytes. So every reader states its needs from the size
of the file or its header, and every build from its grid. Excessive needs are refused with the
figures.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Final, Literal, NamedTuple, Protocol

import numpy as np

from cspace._support.arrays import StrPath
from cspace._support.check import check_count, check_known
from cspace._support.kinds import BRING_YOUR_FILE
from cspace._support.reporting import format_sides, tell_apart
from cspace.errors import FileError, InputError

WORKSPACE_CELL_BYTES: Final = 2
"""Bytes for each cell of a workspace: one in its outer and one in its inner bitmap."""

SHAPE_CELL_BYTES: Final = 6
"""Bytes for each cell while polygons or balls are rasterised, measured. The finished map takes
less."""

MESH_CELL_BYTES: Final = 8
"""Bytes for each cell while a mesh is rasterised: both bitmaps, and labels of the components."""

BITMAP_CELL_BYTES: Final = 280
"""Bytes for each set cell of a robot's bitmap while its symmetries are found, measured."""

UPDATE_CELL_BYTES: Final = 8
"""Bytes for each cell of a box while a map follows its change, besides the states, measured."""

SLICE_BYTES: Final = 2_500
"""Bytes for each slice of a rotating robot, besides the cells of its rasters. Measured: 1,900 to
2,500."""

RASTER_CELL_BYTES: Final = {2: 4, 3: 10}
"""Bytes for each cell of a slice's rasters and their runs, by dimension. Measured: 2 to 4 in the
plane, 8 to 11 in space."""

MAX_MEMORY_FRACTION: Final = 0.95
"""Maximum fraction of the free memory that a build or a reader may use."""


class FileLimits(NamedTuple):
    """Maximum sizes of one file.

    Attributes
    ----------
    max_bytes : int
        Bytes of a file, or of its unpacked content.
    max_cells : int
        Cells, voxels or pixels of its grid.
    max_text_bytes : int
        Bytes of JSON, GeoJSON, WKT, COLLADA and the JSON of glTF, which are parsed as a whole.
    max_description_bytes : int
        Bytes of YAML, URDF and SRDF, which take longest: up to two seconds for this size.
    """

    max_bytes: int = 2**32
    max_cells: int = 2**29
    max_text_bytes: int = 2**26
    max_description_bytes: int = 2**22


SizeLimit = Literal["max_bytes", "max_text_bytes", "max_description_bytes"]
"""Names of the limits that are sizes of files."""


_LIMITS: Final = ContextVar("limits", default=FileLimits())  # noqa: B039 - it cannot be changed


def map_bytes(shape: Sequence[int], slices: int = 1, overlap: bool = False) -> int:
    """Estimate the peak memory of :func:`cspace.build`, in bytes.

    The workspace is not included. A very large robot may need more. ``slices`` is the number of
    stored slices; 1 for a robot that only translates. ``overlap`` says whether overlap counts are
    stored.
    """
    cells = math.prod(map(int, shape)) * slices
    bytes_per_cell = 1 + 4 * overlap  # a state, and a count of 32 bits
    # Bytes for the transforms of a build with a robot at most a hundred cells across. They do not
    # depend on the size of the map.
    return cells * bytes_per_cell + 2**27


FREE_SECONDS: Final = 0.1
"""How long the free memory is known, because to read it takes longer than to make a small map."""

_known_until = -math.inf
_known_bytes = 0.0


def free_bytes() -> float:
    """Return the memory that this process can still use, in bytes.

    That is the free memory of the machine, or the rest of a container's limit, or of the process's
    own (``ulimit -v``).
    """
    global _known_until, _known_bytes
    if time.monotonic() > _known_until:
        import psutil

        available = psutil.virtual_memory().available
        _known_bytes = min(float(available), _container_bytes(), _process_bytes())
        _known_until = time.monotonic() + FREE_SECONDS
    return _known_bytes


@contextmanager
def raised_limits(**limits: int) -> Iterator[None]:
    """Change the limits of files within a ``with`` block.

    Parameters
    ----------
    **limits : int
        New values of the limits, by name: ``max_bytes``, ``max_cells``,
        ``max_text_bytes`` and ``max_description_bytes``.

    Raises
    ------
    InputError
        If there is no such limit.

    Examples
    --------
    >>> with raised_limits(max_cells=2**33):
    ...     pass  # e.g. workspace = cspace.Workspace.open("city.png", spacing=0.05)
    """
    for name, value in limits.items():
        check_known(name, "limits", FileLimits._fields, "name")
        check_count(value, name, 1)
    token = _LIMITS.set(_LIMITS.get()._replace(**limits))
    try:
        yield
    finally:
        _LIMITS.reset(token)


def check_bytes(
    path: StrPath,
    size: int,
    what: str = "holds",
    memory: float = 1.0,
    limit: SizeLimit = "max_bytes",
) -> None:
    """Raise FileError for a file of too many bytes.

    A file is too large if its size exceeds ``max_bytes`` or ``limit``, or if ``memory`` times the
    size does not fit into memory. ``what`` is a verb for the message, such as "holds" or "unpacks
    to".
    """
    limits = _LIMITS.get()
    # Users may have raised one limit above the other; the lower one applies.
    lower_limit = min("max_bytes", limit, key=lambda name: getattr(limits, name))
    size_text, limit_text = tell_apart(size, getattr(limits, lower_limit), 3, bytes_text)
    problem = f"{what} {size_text}"
    _check_limit(path, problem, size, lower_limit, limit_text)
    check_file_memory(path, problem, memory * size)


def check_cells(path: StrPath, shape: Sequence[int], memory: float = 1.0) -> None:
    """Raise FileError for a file that declares too large a grid.

    A grid is too large if it has more than ``max_cells``, or if ``memory`` bytes for each cell do
    not fit into memory.
    """
    count = math.prod(map(int, shape))
    # Sides that a float cannot hold exactly are shortened.
    sides = [f"{n}" if n < 2**53 else f"{n:.4g}" for n in shape]
    declared = f"declares {' x '.join(sides)} cells"
    total, limit = tell_apart(count, _LIMITS.get().max_cells, 4)
    _check_limit(path, f"{declared}, {total} in all", count, "max_cells", limit)
    check_file_memory(path, declared, memory * count)


def check_file_memory(path: StrPath, declared: str, needed: float) -> None:
    """Raise FileError for a file that needs more memory than is free.

    ``declared`` describes the content of the file for the message, and ``needed`` is in bytes.
    """
    free = _find_shortage(needed)
    if free is not None:
        problem, rule = _memory_parts(declared, needed, free)
        raise FileError(os.fspath(path), problem, rule)


def check_samples(n: int | None, size: int) -> int:
    """Return the number of configurations, 1 for None.

    Raises InputError if it is negative, or so many do not fit into memory.
    """
    count = 1 if n is None else check_count(n, "n")
    # Memory for a number of a drawn configuration, bytes: that, and what is drawn for it.
    needed = 32 * float(count) * size
    free = _find_shortage(needed)
    if free is not None:
        problem, rule = _memory_parts(f"is {count}", needed, free)
        raise InputError("n", problem, rule)
    return count


class GridCells(Protocol):
    """Cells of a grid, created or planned: their number, their side and its unit."""

    @property
    def shape(self) -> Sequence[int]: ...

    @property
    def spacing(self) -> float: ...

    @property
    def unit(self) -> str: ...


class PlannedGrid(NamedTuple):
    """Number and side of the cells of a grid to be created."""

    shape: Sequence[int]
    spacing: float
    unit: str = "m"


def check_memory(needed: float, what: str, grid: GridCells, *, slices: int = 1) -> None:
    """Raise InputError for a grid whose processing does not fit into memory.

    Parameters
    ----------
    needed : float
        Memory for all work, bytes.
    what : str
        Subject of the message, such as "the map".
    grid : GridCells
        Of a :class:`PlannedGrid`, the hint names a spacing that fits.
    slices : int
        Number of slices, for the message.
    """
    free = _find_shortage(needed)
    if free is None:
        return
    hint = ""
    if isinstance(grid, PlannedGrid):
        # Other work and rounding take a part, so the advice uses 80 % of the memory.
        excess = max(needed / (0.8 * MAX_MEMORY_FRACTION * free), 1.0)
        coarser = grid.spacing * excess ** (1.0 / len(grid.shape))
        hint = f"cells of {coarser:.2g} {grid.unit} fit"
        sides = grid.spacing * np.array(grid.shape)
        if grid.unit == "m" and sides.max() > 100.0:
            hint += f", if it is {format_sides(sides)} large; for another unit, {BRING_YOUR_FILE}"
    cells = " x ".join(f"{count:.6g}" for count in grid.shape)
    slice_text = f" x {slices:,} slices" if slices > 1 else ""
    description = f"has {cells} cells of {grid.spacing:g} {grid.unit}{slice_text}"
    problem, rule = _memory_parts(description, needed, free)
    raise InputError(what, problem, rule, hint)


def _find_shortage(needed: float) -> float | None:
    """Return the free bytes if so many may not be used; otherwise take them, and return None."""
    # Needs below which the free memory is not queried, because that takes longer than reading.
    if needed < 2**18:
        return None
    global _known_until, _known_bytes
    if needed > MAX_MEMORY_FRACTION * free_bytes():
        _known_until = -math.inf  # what was taken lately may be free again
        free = free_bytes()
        if needed > MAX_MEMORY_FRACTION * free:
            return free
    _known_bytes -= needed
    return None


def _memory_parts(description: str, needed: float, free: float) -> tuple[str, str]:
    """Return the problem and the rule of an error message about memory."""
    needed_text, usable = tell_apart(needed, MAX_MEMORY_FRACTION * free, 3, bytes_text)
    problem = f"{description} and needs about {needed_text} of memory"
    return problem, f"at most {usable} may be used, {MAX_MEMORY_FRACTION:.0%} of the free memory"


def bytes_text(size: float, digits: int = 3) -> str:
    """Format a number of bytes with a unit, e.g. "1.5 GB"."""
    units = ["TB", "GB", "MB", "kB", "bytes"]
    while size >= 999.5 and len(units) > 1:  # 999.5 would be rounded to 1000
        size /= 1000
        units.pop()
    return f"{size:.{digits}g} {units[-1]}"


def _container_bytes() -> float:
    """Return the bytes left below a container's memory limit, which psutil ignores.

    Without a limit, that is infinity. Cached files count as free.
    """
    # In version 2 of control groups, a line "0::/group" names a folder of limits and counters.
    root = Path("/sys/fs/cgroup")
    try:
        membership = Path("/proc/self/cgroup").read_text(encoding="ascii")
        _, _, group = membership.strip().rpartition(":")
        folder = root / group.lstrip("/")
        if not (folder / "memory.max").exists():
            folder = root
        limit = int((folder / "memory.max").read_text(encoding="ascii"))
        used = int((folder / "memory.current").read_text(encoding="ascii"))
        statistics = (folder / "memory.stat").read_text(encoding="ascii").splitlines()
    except (OSError, ValueError):  # no limit: memory.max is missing or reads "max"
        return math.inf
    values = dict(line.split() for line in statistics)
    return max(0, limit - used + int(values.get("inactive_file", 0)))


def _process_bytes() -> float:
    """Return the bytes left below the limit of the process's address space, or infinity."""
    import psutil

    process = psutil.Process()
    if not hasattr(process, "rlimit"):  # other systems than Linux
        return math.inf
    limit, _ = process.rlimit(psutil.RLIMIT_AS)
    if limit == psutil.RLIM_INFINITY:
        return math.inf
    return max(0.0, float(limit - process.memory_info().vms))


def _check_limit(path: StrPath, problem: str, size: int, limit: str, limit_text: str) -> None:
    """Raise FileError if a size exceeds its limit."""
    if size > getattr(_LIMITS.get(), limit):
        hint = f"call cspace.raised_limits({limit}={size}) if the file may be so large"
        rule = f"at most {limit_text} are read"
        raise FileError(os.fspath(path), problem, rule, hint)
