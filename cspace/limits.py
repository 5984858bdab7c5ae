"""Limits of files and of memory, checked before any work; and very rough times of builds.

A file of a few bytes can declare a map of terabytes. So every reader states, from the size of the file or from its
header, what it is about to take; every build does so from its grid. Too much is refused with the figures.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Floats, StrPath
from cspace.errors import CspaceError, FileError, InputError
from cspace.grid import MAX_COORDINATE, Grid
from cspace.threads import cores

WORKSPACE_BYTES: Final = 2
"""For each cell of a workspace: what meets an obstacle, and what lies in one."""

MESH_BYTES: Final = 8
"""For each cell, while a mesh is cut into cells: the above, and the labels that separate inside from outside."""

TRANSFORM_BYTES: Final = 2**27
"""For the transforms of a build with a robot of a hundred cells across or less, whatever the size of the map."""

JOINED_BYTES: Final = 0.1
"""For each state, to join cells into components: measured, 0.06; more where FREE and other cells alternate."""

SLICE_BYTES: Final = 2_500
"""For each slice of a robot that turns: its rotation, and what its rasters take beside their cells. Measured: 1,900 to
2,500."""

RASTER_CELL_BYTES: Final = {2: 4, 3: 10}
"""For each cell of a slice's rasters, with the runs made of them, by dimension. Measured: 2 to 4, and 8 to 11."""

PACKED_FROM: Final = 2**29
"""States above which a map keeps each in two bits: it is four times smaller. Up to here, in a byte, it is quicker."""

PACKED_SLICES: Final = 8
"""Slices below which states are never packed: each slice is made in bytes."""

SCRATCH_BYTES: Final = 2**22
"""For the slices that a thread makes before they are packed; all work at one together, where that takes more."""

KEEP: Final = 0.95
"""Part of the free memory that may be taken."""

FIXED_CELLS: Final = (
    "its cells are those of the file, so take a machine with more memory, or cut the file or make its cells coarser "
    "with the tools of its own format"
)
"""What helps where a file says how large its cells are."""

_MIN_CHECKED_BYTES: Final = 2**18
"""Smaller files are read without asking for the free memory, because that takes longer."""

_COUNTED: Final = 2**53
"""Counts of cells up to here are printed to the last one."""

_ROOM: Final = 0.85 * KEEP
"""Part of the free memory that a spacing is advised for: what is free changes."""


class Limits(NamedTuple):
    """Largest size of one file.

    Attributes
    ----------
    max_bytes : int
        Bytes of a file, or of what it unpacks to.
    max_cells : int
        Cells, voxels or pixels of its grid.
    """

    max_bytes: int = 2**32
    max_cells: int = 2**29


_LIMITS: Final = ContextVar("limits", default=Limits())  # noqa: B039 - it cannot be changed


def map_bytes(shape: Sequence[int], slices: int = 1, overlap: bool = False) -> int:
    """Memory that :func:`cspace.build` takes at most beside its workspace, in bytes, unless the robot is very large.

    ``slices`` are the rotation cells whose slices are stored; 1 for a robot that only translates. ``overlap`` says
    whether overlap counts are stored.
    """
    cells = cells_of(shape) * slices
    if is_packed(shape, slices, overlap):
        return cells // 4 + max(cores() * SCRATCH_BYTES, cells_of(shape)) + TRANSFORM_BYTES
    return cells * (5 if overlap else 1) + TRANSFORM_BYTES


def build_seconds(shape: Sequence[int], slices: int = 1) -> float:
    """Seconds of one core that :func:`cspace.build` takes, very roughly: threefold or a third is usual.

    Parameters as for :func:`map_bytes`. Estimated from measurements on one machine, with robots a few tens of
    cells across: the robot's rasters of each slice, and each state.
    """
    rasters, state = (2e-4, 1e-9) if len(shape) == 2 else (1e-3, 4e-9)
    return slices * (rasters + state * cells_of(shape))


def is_packed(shape: Sequence[int], slices: int, overlap: bool = False) -> bool:
    """Whether a map keeps its states in two bits each; never one with overlap counts, which take far more."""
    return not overlap and slices >= PACKED_SLICES and cells_of(shape) * slices > PACKED_FROM


def free_bytes() -> int:
    """Memory that this process can still take, in bytes: what the machine has, or what a limit leaves it."""
    import psutil

    return int(min(psutil.virtual_memory().available, _left_by_container(), _left_by_limit()))


@contextmanager
def raised_limits(*, max_bytes: int | None = None, max_cells: int | None = None) -> Iterator[None]:
    """Change the limits of files within a ``with`` block.

    Parameters
    ----------
    max_bytes, max_cells : int, optional
        The largest file in bytes, and the most cells of a map; unchanged if left out.

    Examples
    --------
    >>> with raised_limits(max_cells=2**33):
    ...     pass  # e.g. workspace = cspace.Workspace.open("city.png", spacing=0.05)
    """
    now = _LIMITS.get()
    most = now.max_bytes if max_bytes is None else max_bytes
    token = _LIMITS.set(Limits(most, now.max_cells if max_cells is None else max_cells))
    try:
        yield
    finally:
        _LIMITS.reset(token)


def check_bytes(path: StrPath, size: int, what: str = "holds", memory: float = 1.0) -> None:
    """Refuse a file that holds, or for example "unpacks to" (``what``), too many bytes.

    Raises FileError if it is over ``max_bytes``, or ``memory`` times as much does not fit into memory.
    """
    most = _LIMITS.get().max_bytes
    if size > most or memory * size >= _MIN_CHECKED_BYTES:
        held = f"{what} {bytes_text(size)}"
        _check_limit(path, held, size, "max_bytes", bytes_text(most), size)
        check_file_memory(path, held, memory * size)


def check_cells(path: StrPath, shape: Sequence[int], memory: float = 1.0) -> None:
    """Refuse a grid, as a file declares it, that is too large.

    Raises FileError if there are more than ``max_cells``, or ``memory`` bytes for each do not fit into memory.
    """
    count = cells_of(shape)
    declared = f"declares {' x '.join(f'{n}' if n < 2**53 else f'{n:.4g}' for n in shape)} cells"
    most = f"{_LIMITS.get().max_cells:.4g}"
    _check_limit(path, f"{declared}, {count:.4g} in all", count, "max_cells", most, tuple(shape))
    check_file_memory(path, declared, memory * count)


def check_file_memory(path: StrPath, declared: str, needed: float) -> None:
    """Refuse a file that takes more memory to read than is free.

    ``declared`` says what the file holds, and ``needed`` is in bytes. Raises FileError.
    """
    if needed >= _MIN_CHECKED_BYTES and needed > KEEP * (free := free_bytes()):
        hint = "take a machine with more memory, or a smaller or coarser file"
        raise out_of_memory(os.fspath(path), declared, needed, free, hint, error=FileError)


class Planned(NamedTuple):
    """A grid that is not made before it is known to fit; lengths in metres, or in ``unit``."""

    shape: Sequence[int]
    spacing: float
    lower: Sequence[float] | Floats
    upper: Sequence[float] | Floats
    unit: str = "m"


def check_memory(
    needed: float,
    what: str,
    grid: Grid | Planned,
    *,
    fixed: float = 0.0,
    hint: str | None = None,
    fewer: Callable[[float], str] | None = None,
    seconds: float = 0.0,
    later: float = 0.0,
    slices: int = 1,
    rasters: float = 0.0,
) -> None:
    """Refuse work that does not fit into memory; the message gives the spacing that would fit, or else ``hint``.

    It needs so many bytes, of which ``fixed`` do not depend on the number of cells of ``grid``. Of these bytes,
    ``rasters`` are for the robot's rasters and proportional to the number of slices; all others are proportional to the
    number of cells. ``what`` says who needs them: "the map". ``hint`` helps where another spacing cannot be
    chosen; ``fewer`` names the rotation cells that take at most a share of the memory, an empty text where none do.
    ``seconds`` are those of one core. Where more is needed next, of what this is for, the advice is for ``later``.
    """
    free = free_bytes()
    if needed <= KEEP * free:
        return
    if hint is None:
        # A robot's rasters are the same on a smaller map, and not much smaller at a coarser spacing.
        left, whole = _ROOM * free - fixed, max(needed, later) - fixed
        bytes_a_cell = max((whole - rasters) / float(np.prod(np.asarray(grid.shape, dtype=float))), 1e-9)
        coarser = fitting_spacing(np.array([grid.lower, grid.upper]), grid.spacing, (left - rasters) / bytes_a_cell)
        rotations = fewer(left / (needed - fixed)) if fewer else ""
        if coarser is not None:
            hint = f"use a spacing of at least {coarser:g} {grid.unit}, or smaller bounds, or check the units (metres)"
        else:
            hint = f"{'' if rotations else 'no spacing helps; '}take a machine with more memory"
        hint = f"use {rotations}, or {hint.removeprefix('use ')}" if rotations else hint
    cells = " x ".join(f"{n:.4g}" if n > _COUNTED else str(n) for n in grid.shape)
    turning = f" x {slices:,} slices" if slices > 1 else ""
    time = f", and very roughly {time_text(seconds)} of one core" if seconds else ""
    raise out_of_memory(what, f"has {cells} cells of {grid.spacing:g} {grid.unit}{turning}", needed, free, hint, time)


def out_of_memory(
    argument: str,
    problem: str,
    needed: float,
    free: float,
    hint: str,
    time: str = "",
    *,
    error: type[CspaceError] = InputError,
) -> CspaceError:
    """Return the error for work that needs more bytes than may be taken of those that are free."""
    return error(
        argument,
        f"{problem} and needs about {bytes_text(needed)} of memory{time}",
        f"at most {bytes_text(KEEP * free)} may be taken, which is {KEEP:.0%} of what is free",
        hint,
        value=needed,
    )


def fitting_spacing(corners: Floats, spacing: float, max_cells: float) -> float | None:
    """Estimate the spacing, to two digits, at which a box has at most ``max_cells`` cells.

    The corners of the box have the shape (2, d), metres. The result is at least ``spacing``, and keeps the grid to
    :data:`cspace.grid.MAX_COORDINATE`. None if not even one cell fits.
    """
    if max_cells < 1.0:
        return None
    fitting = max(spacing, float(np.abs(corners).max()) / (MAX_COORDINATE - 1.0))
    # Sides shorter than the spacing are one cell, so only the longer sides count.
    sides = np.sort(corners[1] - corners[0])[::-1].tolist()
    for count in range(len(sides), 0, -1):
        side = math.exp((sum(math.log(max(s, 1e-300)) for s in sides[:count]) - math.log(max_cells)) / count)
        if side <= sides[count - 1]:
            fitting = max(fitting, side)
            break
    # Rounded up: in decimal digits, as it is going to be printed.
    unit = 10.0 ** (math.floor(math.log10(fitting)) - 1)
    return float(f"{math.ceil(fitting / unit) * unit:.2g}")


def bytes_text(size: float) -> str:
    """A number of bytes for people."""
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if size < 999.5 or unit == "TB":
            return f"{size:.3g} {unit}"
        size /= 1000
    return ""


def time_text(seconds: float) -> str:
    """A time for people, to one digit, as it is a rough one."""
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * size:
            return f"{float(f'{seconds / size:.1g}'):,.0f} {unit}"
    return f"{float(f'{seconds:.1g}'):g} s"


def cells_of(shape: Sequence[int]) -> int:
    """Number of cells, as a whole number of any size."""
    return math.prod(map(int, shape))


def _left_by_container() -> float:
    """What a container's limit leaves the process, which psutil does not look at; files in the cache count as free."""
    folder = Path("/sys/fs/cgroup")
    try:
        group = Path("/proc/self/cgroup").read_text(encoding="ascii").strip().rpartition(":")[2]
        folder = next(f for f in (folder / group.lstrip("/"), folder) if (f / "memory.max").exists())
        limit, used = (int((folder / name).read_text(encoding="ascii")) for name in ("memory.max", "memory.current"))
        lines = (folder / "memory.stat").read_text(encoding="ascii").splitlines()
    except (OSError, StopIteration, ValueError):  # no such limit, which then reads "max"
        return math.inf
    cached = next((int(line.split()[1]) for line in lines if line.startswith("inactive_file ")), 0)
    return max(0, limit - used + cached)


def _left_by_limit() -> float:
    """What the limit of a process's addresses (``ulimit -v``) leaves it, where the system has such limits."""
    import psutil

    try:
        import resource
    except ImportError:
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return math.inf if limit == resource.RLIM_INFINITY else max(0, limit - psutil.Process().memory_info().vms)


def _check_limit(path: StrPath, problem: str, number: int, limit: str, most: str, value: object) -> None:
    if number > getattr(_LIMITS.get(), limit):
        hint = f"raise it with cspace.limits.raised_limits({limit}={number}), if the file is meant to be so large"
        raise FileError(os.fspath(path), problem, f"at most {most} are read", hint, value=value)
