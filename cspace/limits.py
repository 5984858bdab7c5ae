"""Limits of files and of memory, checked before any work; and rough build times.

A file of a few bytes can declare a map of terabytes. So every reader states its needs from the size of the file or its
header, and every build from its grid. Excessive needs are refused with the figures.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np

from cspace.arrays import Floats, StrPath
from cspace.errors import CspaceError, FileError, InputError
from cspace.grid import MAX_COORDINATE, Grid

WORKSPACE_CELL_BYTES: Final = 2
"""Memory for each cell of a workspace: its outer and its inner bitmap."""

MESH_CELL_BYTES: Final = 8
"""Memory for each cell while a mesh is rasterised: both bitmaps, and labels of the components."""

TRANSFORM_BYTES: Final = 2**27
"""Memory for the transforms of a build with a robot at most a hundred cells across, whatever the size of the map."""

SLICE_BYTES: Final = 2_500
"""Memory for each slice of a rotating robot beside the cells of its rasters. Measured: 1,900 to 2,500."""

RASTER_CELL_BYTES: Final = {2: 4, 3: 10}
"""Memory for each cell of a slice's rasters and their runs, by dimension. Measured: 2 to 4, and 8 to 11."""

MAX_MEMORY_FRACTION: Final = 0.95
"""Maximum fraction of the free memory that work may use."""

FIXED_CELLS_HINT: Final = (
    "its cells are those of the file, so take a machine with more memory, or cut the file or make its cells coarser "
    "with the tools of its own format"
)
"""Hint for files that declare the size of their cells."""

_MIN_CHECKED_BYTES: Final = 2**18
"""Size of files below which the free memory is not queried, because that takes longer than reading."""

_MAX_EXACT_COUNT: Final = 2**53
"""Counts of cells up to here are printed exactly."""

_ADVISED_FRACTION: Final = 0.85 * MAX_MEMORY_FRACTION
"""Fraction of the free memory that an advised spacing uses, because the free memory changes."""


class Limits(NamedTuple):
    """Maximum size of one file.

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


_LIMITS: Final = ContextVar("limits", default=Limits())  # noqa: B039 - it cannot be changed


def map_bytes(shape: Sequence[int], slices: int = 1, overlap: bool = False) -> int:
    """Estimate the peak memory of :func:`cspace.build`, in bytes.

    The workspace is not included. It may be more if the robot is very large. ``slices`` is the number of stored slices;
    1 for a robot that only translates. ``overlap`` says whether overlap counts are stored.
    """
    cells = count_cells(shape) * slices
    return cells * (5 if overlap else 1) + TRANSFORM_BYTES


def build_seconds(shape: Sequence[int], slices: int = 1) -> float:
    """Estimate the time of :func:`cspace.build` on one core.

    The factor of uncertainty is about three. Parameters as for :func:`map_bytes`. Fitted to measurements on one
    machine, with robots a few tens of cells across: the rasters of each slice, and each state.
    """
    rasters, state = (2e-4, 1e-9) if len(shape) == 2 else (1e-3, 4e-9)
    return slices * (rasters + state * count_cells(shape))


def free_bytes() -> int:
    """Return the memory that this process can still use, in bytes.

    That is the free memory of the machine, or the rest of a container's or a process's limit.
    """
    import psutil

    return int(min(psutil.virtual_memory().available, _container_bytes(), _address_bytes()))


@contextmanager
def raised_limits(
    *,
    max_bytes: int | None = None,
    max_cells: int | None = None,
    max_text_bytes: int | None = None,
    max_description_bytes: int | None = None,
) -> Iterator[None]:
    """Change the limits of files within a ``with`` block.

    Parameters
    ----------
    max_bytes : int, optional
        Maximum size of any file, in bytes; unchanged if left out, like all others.
    max_cells : int, optional
        Maximum number of cells of a map.
    max_text_bytes : int, optional
        Maximum size of JSON, GeoJSON, WKT, COLLADA and glTF without its buffers, in bytes.
    max_description_bytes : int, optional
        Maximum size of YAML, URDF and SRDF, in bytes.

    Examples
    --------
    >>> with raised_limits(max_cells=2**33):
    ...     pass  # e.g. workspace = cspace.Workspace.open("city.png", spacing=0.05)
    """
    given = {
        "max_bytes": max_bytes,
        "max_cells": max_cells,
        "max_text_bytes": max_text_bytes,
        "max_description_bytes": max_description_bytes,
    }
    changes = {name: value for name, value in given.items() if value is not None}
    token = _LIMITS.set(_LIMITS.get()._replace(**changes))
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
    """Refuse a file of too many bytes.

    ``what`` is a verb for the message, such as "holds" or "unpacks to". Raises FileError if the size exceeds
    ``max_bytes`` or ``limit``, or ``memory`` times the size does not fit into memory.
    """
    problem = f"{what} {bytes_text(size)}"
    limits = _LIMITS.get()
    name = min("max_bytes", limit, key=lambda each: getattr(limits, each))
    _check_limit(path, problem, size, name, bytes_text(getattr(limits, name)), size)
    check_file_memory(path, problem, memory * size)


def check_cells(path: StrPath, shape: Sequence[int], memory: float = 1.0) -> None:
    """Refuse a file that declares too large a grid.

    Raises FileError if there are more than ``max_cells``, or ``memory`` bytes for each do not fit into memory.
    """
    count = count_cells(shape)
    declared = f"declares {' x '.join(f'{n}' if n < 2**53 else f'{n:.4g}' for n in shape)} cells"
    limit = f"{_LIMITS.get().max_cells:.4g}"
    _check_limit(path, f"{declared}, {count:.4g} in all", count, "max_cells", limit, tuple(shape))
    check_file_memory(path, declared, memory * count)


def check_file_memory(path: StrPath, declared: str, needed: float) -> None:
    """Refuse a file that needs more memory than is free.

    ``declared`` describes the content of the file, and ``needed`` is in bytes. Raises FileError.
    """
    if needed >= _MIN_CHECKED_BYTES and needed > MAX_MEMORY_FRACTION * (free := free_bytes()):
        hint = "take a machine with more memory, or a smaller or coarser file"
        raise out_of_memory(os.fspath(path), declared, needed, free, hint, error=FileError)


class PlannedGrid(NamedTuple):
    """A grid that is not made before it is known to fit.

    Lengths are in metres, or in ``unit``.
    """

    shape: Sequence[int]
    spacing: float
    lower: Sequence[float] | Floats
    upper: Sequence[float] | Floats
    unit: str = "m"


def check_memory(
    needed: float,
    what: str,
    grid: Grid | PlannedGrid,
    *,
    fixed: float = 0.0,
    hint: str | None = None,
    fewer: Callable[[float], str] | None = None,
    seconds: float = 0.0,
    later: float = 0.0,
    slices: int = 1,
    rasters: float = 0.0,
) -> None:
    """Refuse work that does not fit into memory.

    The message gives the spacing that would fit, or else ``hint``.

    Parameters
    ----------
    needed : float
        Bytes in all.
    what : str
        Argument of the message: "the map".
    grid : Grid or PlannedGrid
    fixed : float
        Bytes that do not depend on the number of cells of ``grid``.
    hint : str, optional
        Hint if another spacing cannot be chosen.
    fewer : callable, optional
        Given a fraction, names the rotation cells that use at most this fraction of the memory; empty if there are
        none.
    seconds : float
        Time on one core.
    later : float
        Bytes that the next step needs, if more; the advised spacing fits those.
    slices : int
    rasters : float
        Bytes of the robot's rasters, proportional to the number of slices; all others are proportional to the cells.
    """
    free = free_bytes()
    if needed <= MAX_MEMORY_FRACTION * free:
        return
    if hint is None:
        # A robot's rasters are the same on a smaller map, and not much smaller at a coarser spacing.
        available, total = _ADVISED_FRACTION * free - fixed, max(needed, later) - fixed
        bytes_a_cell = max((total - rasters) / float(np.prod(np.asarray(grid.shape, dtype=float))), 1e-9)
        coarser = fitting_spacing(
            np.array([grid.lower, grid.upper]), grid.spacing, (available - rasters) / bytes_a_cell
        )
        rotations = fewer(available / (needed - fixed)) if fewer else ""
        if coarser is not None:
            hint = f"use a spacing of at least {coarser:g} {grid.unit}, or smaller bounds, or check the units (metres)"
        else:
            hint = f"{'' if rotations else 'no spacing helps; '}take a machine with more memory"
        hint = f"use {rotations}, or {hint.removeprefix('use ')}" if rotations else hint
    cells = " x ".join(f"{n:.4g}" if n > _MAX_EXACT_COUNT else str(n) for n in grid.shape)
    slice_text = f" x {slices:,} slices" if slices > 1 else ""
    time = f", and very roughly {time_text(seconds)} of one core" if seconds else ""
    raise out_of_memory(
        what, f"has {cells} cells of {grid.spacing:g} {grid.unit}{slice_text}", needed, free, hint, time
    )


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
    """Return the error for work beyond the memory limit."""
    return error(
        argument,
        f"{problem} and needs about {bytes_text(needed)} of memory{time}",
        f"at most {bytes_text(MAX_MEMORY_FRACTION * free)} may be used, {MAX_MEMORY_FRACTION:.0%} of the free memory",
        hint,
        value=needed,
    )


def fitting_spacing(corners: Floats, spacing: float, max_cells: float) -> float | None:
    """Estimate the spacing at which a box has at most ``max_cells`` cells.

    The corners of the box have the shape (2, d), metres. The result has two digits, is at least ``spacing``, and keeps
    the grid to :data:`cspace.grid.MAX_COORDINATE`. None if not even one cell fits.
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
    # Round up to two decimal digits, because the result is printed.
    unit = 10.0 ** (math.floor(math.log10(fitting)) - 1)
    return float(f"{math.ceil(fitting / unit) * unit:.2g}")


def bytes_text(size: float) -> str:
    """Format a number of bytes for people."""
    for unit in ("bytes", "kB", "MB", "GB", "TB"):
        if size < 999.5 or unit == "TB":
            return f"{size:.3g} {unit}"
        size /= 1000
    return ""


def time_text(seconds: float) -> str:
    """Format a rough time for people, to one digit."""
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2.0 * size:
            return f"{float(f'{seconds / size:.1g}'):,.0f} {unit}"
    return f"{float(f'{seconds:.1g}'):g} s"


def count_cells(shape: Sequence[int]) -> int:
    """Return the number of cells, as an integer of any size."""
    return math.prod(map(int, shape))


def _container_bytes() -> float:
    """Return the memory left by a container's limit, which psutil ignores.

    Cached files count as free.
    """
    folder = Path("/sys/fs/cgroup")
    try:
        group = Path("/proc/self/cgroup").read_text(encoding="ascii").strip().rpartition(":")[2]
        folder = next(f for f in (folder / group.lstrip("/"), folder) if (f / "memory.max").exists())
        limit, used = (int((folder / name).read_text(encoding="ascii")) for name in ("memory.max", "memory.current"))
        lines = (folder / "memory.stat").read_text(encoding="ascii").splitlines()
    except (OSError, StopIteration, ValueError):  # no limit: memory.max is missing or reads "max"
        return math.inf
    cached = next((int(line.split()[1]) for line in lines if line.startswith("inactive_file ")), 0)
    return max(0, limit - used + cached)


def _address_bytes() -> float:
    """Return the memory that the address-space limit leaves.

    The limit is that of ``ulimit -v``.
    """
    import psutil

    try:
        import resource
    except ImportError:
        return math.inf
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return math.inf if limit == resource.RLIM_INFINITY else max(0, limit - psutil.Process().memory_info().vms)


def _check_limit(path: StrPath, problem: str, size: int, limit: str, limit_text: str, value: object) -> None:
    """Raise FileError if a value exceeds a limit of files."""
    if size > getattr(_LIMITS.get(), limit):
        hint = f"raise it with cspace.limits.raised_limits({limit}={size}), if the file is meant to be so large"
        raise FileError(os.fspath(path), problem, f"at most {limit_text} are read", hint, value=value)
