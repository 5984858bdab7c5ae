"""Tasks over tiles, in threads or on a cluster."""

from __future__ import annotations

import itertools
import math
import pickle
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from importlib import import_module
from threading import get_ident
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace.arrays import Bools, Ints, States
from cspace.engines.slices import Correlation, RasterPair, group_rasters, slice_rasters
from cspace.errors import CspaceError, FileError, InputError, import_optional
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.obstacles import Source, changed_source
from cspace.store import Index, Record, Store
from cspace.threads import cores, in_threads

if TYPE_CHECKING:
    from distributed import Client

Read = Callable[[tuple[slice, ...]], tuple[Bools, Bools]]

MAX_INLINE_BYTES: Final = 2**18
"""Largest job that is sent with every task; larger jobs are scattered to the workers once."""

TASKS_PER_SUBMIT: Final = 1024
"""Tasks submitted to the scheduler at a time, and pending tasks below which the next ones are submitted."""

DASK_USE: Final = "it runs tasks on the workers of a cluster"
"""Why dask is needed, for the error if it is not installed."""

WORKER_TIMEOUT_SECONDS: Final = 60.0
"""Seconds without any worker after which the cluster counts as lost."""

POLL_FRACTION: Final = 0.01
"""Interval between polls of the cluster, as a fraction of the elapsed time.

A poll gathers all finished tasks; a message for each tile would take 10 % of the time.
"""

MIN_POLL_SECONDS: Final = 0.02
"""Shortest interval between polls of the cluster."""

MAX_POLL_SECONDS: Final = 0.2
"""Longest interval between polls of the cluster."""


@dataclass(frozen=True)
class Job:
    """A store, and the workspace of its tiles.

    Attributes
    ----------
    store : Store
    source : Source
        Workspace cells.
    threads : int
        Threads of the engine, per tile.
    """

    store: Store
    source: Source
    threads: int = 1

    @cached_property
    def pairs(self) -> list[RasterPair]:
        """Rasters of the robot for each slice."""
        store = self.store
        return slice_rasters(store.robot, store.grid.spacing, store.metadata["margin_m"], store.rotations)

    @cached_property
    def reach(self) -> Ints:
        """Bounds of the robot's cells over all slices, shape (2, d).

        They are relative to the robot's own cell.
        """
        rasters = [raster for pair in self.pairs for raster in pair if raster.cells.size]
        origin = [[0] * self.store.grid.dim]
        low = np.min([*origin, *(raster.lower for raster in rasters)], axis=0)
        return np.array([low, np.max([*origin, *(raster.upper for raster in rasters)], axis=0)])

    def window(self, box: Sequence[slice]) -> tuple[slice, ...]:
        """Return the workspace cells that determine a box."""
        start = np.maximum([part.start for part in box] + self.reach[0], 0)
        stop = np.minimum([part.stop for part in box] + self.reach[1], self.store.grid.shape)
        return tuple(map(slice, start.tolist(), stop.tolist()))

    def bytes_needed(self) -> int:
        """Return an upper bound of a task's bytes.

        The robot's rasters are not counted.
        """
        store, grid = self.store, self.store.grid
        sides = np.minimum(np.array(store.tile) + self.reach[1] - self.reach[0], grid.shape)
        states = store.depth * int(np.prod(store.tile))
        # About eight slices represent all.
        sample = group_rasters(self.pairs[:: max(1, len(self.pairs) // 8)], store.proves_blocked is not False)
        engine = Correlation.create(store.metadata["method"], sample, "blocked", 1).engine
        return (
            3 * int(np.prod(sides))
            + 2 * states
            + max(engine.bytes_needed(sides.tolist(), side, self.threads) for side in sample)
        )

    def read(self, box: tuple[slice, ...]) -> tuple[Bools, Bools]:
        """Return outer and inner workspace cells of a box.

        Raises FileError if the workspace has changed since the build began.
        """
        outer, inner = self.source.read(box)
        if self.source.stamp != self.store.metadata["stamp"]:
            raise changed_source(self.store.metadata["workspace_source"], "its size, time or digest differs")
        return outer, inner

    @cached_property
    def _scratch_by_thread(self) -> dict[int, NDArray[np.uint8]]:
        return {}

    def _scratch(self, size: int) -> NDArray[np.uint8]:
        """Return this thread's scratch buffer.

        Allocating one per task would cost as much as the engine.
        """
        scratch = self._scratch_by_thread.get(get_ident())
        if scratch is None or len(scratch) < size:
            scratch = self._scratch_by_thread[get_ident()] = np.empty(size, dtype=np.uint8)
        return scratch[:size]

    def build_tile(self, index: Index, read: Read | None = None, aside: str = "") -> Record:
        """Build a tile and write it; return its record."""
        store, box = self.store, self.store.cells(index)
        window = self.window(box)
        outer, inner = (read or self.read)(window)
        offset = [part.start - around.start for part, around in zip(box, window, strict=True)]
        shape = tuple(part.stop - part.start for part in box)
        tile_cells = tuple(map(slice, offset, np.add(offset, shape).tolist()))
        scratch = self._scratch(store.depth * math.prod(shape)).reshape(-1, *shape)

        def blocks() -> Iterator[States]:
            for layer in range(store.layers):
                numbers = store.numbers(layer)
                block = scratch[: len(numbers)]
                # Cell 0 of the tile is cell `offset` of the window, so the rasters move by that.
                pairs = [
                    (a.translate(offset), b.translate(offset)) for a, b in (self.pairs[number] for number in numbers)
                ]
                sides = group_rasters(pairs, store.proves_blocked is not False)
                engine = Correlation.create(store.metadata["method"], sides, store.metadata["outside"], self.threads)
                engine.fill(outer, inner, sides, block, None)
                yield block

        def cells() -> Iterator[Bools]:
            for part in (outer,) if store.metadata["same"] else (outer, inner):
                scratch[0] = part[tile_cells]
                yield scratch[0].view(np.bool_)

        return store.write_tile(index, blocks(), cells(), aside)


# ---- many tiles ------------------------------------------------------------------------------------------------------


def run_tasks(
    task: Callable[[Job, Index], Any],
    job: Job,
    tiles: Sequence[Index],
    client: Client | None,
    workers: int | None,
    progress: Callable[[int], None] | None = None,
) -> list[Any]:
    """Run a task for each tile; return the results.

    Tasks run in threads or on the workers of a cluster. Raises InputError if a task exceeds the memory, CspaceError if
    the cluster fails, and any error of a task.
    """
    if not tiles:
        return []
    if client is not None:
        return _run_on_cluster(task, job, tiles, client, progress)
    needed = job.bytes_needed()
    max_threads = int(MAX_MEMORY_FRACTION * free_bytes() // needed)
    if max_threads < 1:
        raise _memory_error(job, needed, MAX_MEMORY_FRACTION * free_bytes())
    threads = min(workers or cores(), len(tiles), max_threads)
    job = Job(job.store, job.source, max(1, (workers or cores()) // threads))
    _ = job.reach  # compute it once, before the threads need it
    return in_threads(partial(task, job), tiles, threads, progress)


def _memory_error(job: Job, needed: float, free: float) -> InputError:
    """Return the error for a tile too large for a worker."""
    reach = " x ".join(map(str, (job.reach[1] - job.reach[0]).tolist()))
    return InputError(
        "tile",
        f"is {' x '.join(map(str, job.store.tile))} cells; with the robot's reach of {reach} cells a task needs "
        f"{bytes_text(needed)}",
        f"{bytes_text(free)} are available",
        "use a smaller tile, or workers with more memory",
        value=job.store.tile,
    )


class _Task:
    """A task for worker processes, for one run.

    Each process opens the store at the first call of a run and keeps it. The store may change between runs, so each run
    has a name of its own.
    """

    def __init__(self, task: Callable[[Job, Index], Any], path: str, source: Source) -> None:
        self._task, self._path, self._source, self._run = task, path, source, uuid.uuid4().hex

    @cached_property
    def job(self) -> Job:
        """The job, with this worker's store."""
        return Job(Store.open(self._path), self._source)

    def __call__(self, index: Index) -> Any:
        return self._task(self.job, index)


@lru_cache(1)
def _load_task(content: bytes) -> _Task:
    """Unpickle a task, once for each run.

    Raise FileError if a file of its workspace is missing on this machine.
    """
    try:
        task: _Task = pickle.loads(content)
    except OSError as error:
        problem = f"cannot be read by a worker: {error.strerror or error}"
        rule = "all machines must see the folders of the workspace and the store"
        hint = "use a shared folder, or build without a client"
        raise FileError(str(error.filename or "the workspace"), problem, rule, hint) from error
    return task


def perform_task(content: bytes, index: Index) -> Any:
    """Run a pickled task on a worker.

    Its version of cspace must be the sender's.
    """
    try:
        return _load_task(content)(index)
    except CspaceError as error:
        # The cause may be of any class, and not every class can be pickled.
        error.__cause__ = error.__context__ = None
        raise


def _version_error(versions: set[Any]) -> CspaceError:
    """Return the error for workers with another version of cspace."""
    names = ", ".join(sorted("none" if version is None else str(version) for version in versions))
    return InputError(
        "client",
        f"has workers with cspace {names}",
        f"all must have cspace {__version__}, like this process",
        "install it on the workers and restart them",
        value=versions,
    )


def _cluster_error(reason: str) -> CspaceError:
    """Return the error for a lost cluster."""
    return InputError(
        "client",
        f"lost its scheduler or its workers ({reason})",
        "the cluster must be running",
        "restart it and repeat the call: finished tiles are kept",
    )


def _run_on_cluster(
    task: Callable[[Job, Index], Any],
    job: Job,
    tiles: Sequence[Index],
    client: Any,
    progress: Callable[[int], None] | None,
) -> list[Any]:
    """Run a task for each tile on a cluster.

    See :func:`run_tasks`.
    """
    distributed = import_optional("distributed", DASK_USE, "distributed")

    # A worker dies if it cannot unpickle a message. So the nested functions are sent by value, use of cspace only what
    # every version has until they have compared the versions, and take everything else as bytes.

    def installed_version() -> str | None:
        try:
            return str(import_module("cspace").__version__)
        except ImportError:
            return None

    def describe_worker(dask_worker: Any) -> tuple[str | None, Any]:
        limit = getattr(dask_worker.memory_manager, "memory_limit", None)
        return installed_version(), limit and limit / max(1, dask_worker.state.nthreads)

    def call(index: Index, content: bytes, version: str) -> tuple[str | None, Any]:
        version_here = installed_version()
        if version_here != version:
            return version_here, None
        from cspace.tiles.work import perform_task

        return version_here, perform_task(content, index)

    futures: dict[Any, int] = {}
    results: list[Any] = [None] * len(tiles)
    try:
        answers = client.run(describe_worker).values()
        if not answers:
            raise InputError("client", "has no workers", "tasks run on them", "start one, e.g. dask worker ADDRESS")
        if {version for version, _ in answers} != {__version__}:
            raise _version_error({version for version, _ in answers})
        free, needed = min((limit for _, limit in answers if limit), default=0), job.bytes_needed()
        if free and needed > free:
            raise _memory_error(job, needed, free)
        content: Any = pickle.dumps(_Task(task, str(job.store.path.resolve()), job.source))
        if len(content) > MAX_INLINE_BYTES:
            # Every worker gets a copy, because a single copy would be lost with its worker.
            content = client.scatter(content, hash=False, broadcast=True)
        waiting = iter(enumerate(tiles))
        running = distributed.as_completed([])
        done, last_result = 0, (began := time.monotonic())
        while done < len(tiles):
            if len(futures) < TASKS_PER_SUBMIT and (more := dict(itertools.islice(waiting, TASKS_PER_SUBMIT))):
                new = client.map(call, list(more.values()), content=content, version=__version__, pure=False, retries=3)
                futures.update(zip(new, more, strict=True))
                running.update(new)
            batch = running.next_batch(block=False)
            for future, (version, result) in zip(batch, client.gather(batch) if batch else (), strict=True):
                if version != __version__:  # a worker that joined after the check above
                    raise _version_error({version})
                results[futures.pop(future)] = result
                done, last_result = done + 1, time.monotonic()
                if progress is not None:
                    progress(done)
            if time.monotonic() - last_result > WORKER_TIMEOUT_SECONDS and not client.scheduler_info()["workers"]:
                raise _cluster_error(f"none for {WORKER_TIMEOUT_SECONDS:g} s")
            interval = POLL_FRACTION * (time.monotonic() - began)
            time.sleep(min(max(interval, MIN_POLL_SECONDS), MAX_POLL_SECONDS))
        return results
    except CspaceError:
        raise
    except Exception as error:
        # A client may raise any exception if its scheduler dies; then its status tells.
        lost = distributed.scheduler.KilledWorker, distributed.CancelledError, OSError, TimeoutError
        if isinstance(error, lost) or client.status != "running":
            raise _cluster_error(f"{type(error).__name__}: {error}") from error
        raise
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.cancel(list(futures))
