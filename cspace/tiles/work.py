"""The work on one tile: its window of the workspace, the engine, its chunks; and many of them, here or on a cluster."""

from __future__ import annotations

import itertools
import math
import pickle
import time
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

SMALL: Final = 2**18
"""Bytes up to which what a task needs is sent with each of them."""

AHEAD: Final = 1024
"""Tasks that a scheduler is given at a time, at least."""

CLUSTER: Final = "tiles are made on the workers of a cluster with it"
"""What dask is of use for."""

PATIENCE: Final = 60.0
"""Seconds without any worker after which a cluster is given up."""

PAUSE: Final = (0.01, 0.02, 0.2)
"""Part of the time so far between two looks at what a cluster has done, and seconds at least and at most: what has been
done until then is fetched at once, since a message for each tile would take a tenth of the time."""


@dataclass(frozen=True)
class Job:
    """What makes tiles of a store.

    Attributes
    ----------
    store : Store
    source : Source
        The cells of the workspace.
    threads : int
        Of the engine, for each tile.
    """

    store: Store
    source: Source
    threads: int = 1

    @cached_property
    def pairs(self) -> list[RasterPair]:
        """The rasters of the robot, for each slice."""
        store = self.store
        return slice_rasters(store.robot, store.grid.spacing, store.metadata["margin"], store.rotations)

    @cached_property
    def reach(self) -> Ints:
        """How far before and after a cell the robot reaches in any slice, shape (2, d)."""
        parts = [raster for pair in self.pairs for raster in pair if raster.cells.size]
        none = [[0] * self.store.grid.dim]
        low = np.min([*none, *(raster.lower for raster in parts)], axis=0)
        return np.array([low, np.max([*none, *(raster.upper for raster in parts)], axis=0)])

    def window(self, box: Sequence[slice]) -> tuple[slice, ...]:
        """The cells of the workspace that decide about a box of states."""
        first = np.maximum([part.start for part in box] + self.reach[0], 0)
        stop = np.minimum([part.stop for part in box] + self.reach[1], self.store.grid.shape)
        return tuple(map(slice, first.tolist(), stop.tolist()))

    def bytes_needed(self) -> int:
        """Memory that a task takes at most, in bytes, but for the rasters of the robot."""
        store, grid = self.store, self.store.grid
        sides = np.minimum(np.array(store.tile) + self.reach[1] - self.reach[0], grid.shape)
        states = store.depth * int(np.prod(store.tile))
        part = group_rasters(self.pairs[:: max(1, len(self.pairs) // 8)], store.proves_blocked is not False)
        engine = Correlation.create(store.metadata["method"], part, "blocked", 1).engine
        return (
            3 * int(np.prod(sides))
            + 2 * states
            + max(engine.bytes_needed(sides.tolist(), side, self.threads) for side in part)
        )

    def read(self, box: tuple[slice, ...]) -> tuple[Bools, Bools]:
        """Cells of the workspace, which is as it was when the build began.

        Raises FileError if it is not.
        """
        outer, inner = self.source.read(box)
        if self.source.stamp != self.store.metadata["stamp"]:
            raise changed_source(self.store.metadata["workspace_source"], "its size, its time or its digest is another")
        return outer, inner

    @cached_property
    def _rooms(self) -> dict[int, NDArray[np.uint8]]:
        return {}

    def _room(self, size: int) -> NDArray[np.uint8]:
        """Bytes of this thread's own, which one task after another uses: new ones would cost as much as the engine."""
        room = self._rooms.get(get_ident())
        if room is None or len(room) < size:
            room = self._rooms[get_ident()] = np.empty(size, dtype=np.uint8)
        return room[:size]

    def make(self, index: Index, read: Read | None = None, aside: str = "") -> Record:
        """Make a tile and write it."""
        store, box = self.store, self.store.cells(index)
        window = self.window(box)
        outer, inner = (read or self.read)(window)
        before = [part.start - around.start for part, around in zip(box, window, strict=True)]
        shape = tuple(part.stop - part.start for part in box)
        own = tuple(map(slice, before, np.add(before, shape).tolist()))
        room = self._room(store.depth * math.prod(shape)).reshape(-1, *shape)

        def blocks() -> Iterator[States]:
            for layer in range(store.layers):
                numbers = store.numbers(layer)
                block = room[: len(numbers)]
                # From a tile's first cell on, the cells of its window are as much farther.
                pairs = [
                    (a.translate(before), b.translate(before)) for a, b in (self.pairs[number] for number in numbers)
                ]
                sides = group_rasters(pairs, store.proves_blocked is not False)
                engine = Correlation.create(store.metadata["method"], sides, store.metadata["outside"], self.threads)
                engine.fill(outer, inner, sides, block, None)
                yield block

        def cells() -> Iterator[Bools]:
            for part in (outer,) if store.metadata["same"] else (outer, inner):
                room[0] = part[own]
                yield room[0].view(np.bool_)

        return store.write_tile(index, blocks(), cells(), aside)


# ---- many tiles ------------------------------------------------------------------------------------------------------


def run(
    task: Callable[[Job, Index], Any],
    job: Job,
    todo: Sequence[Index],
    client: Client | None,
    workers: int | None,
    progress: Callable[[int], None] | None = None,
) -> list[Any]:
    """What a task gives for each of some tiles, here in threads or on the workers of a cluster.

    Raises InputError if a task does not fit into the memory that it may take, and CspaceError if the cluster cannot do
    it, or what a task raises.
    """
    if not todo:
        return []
    if client is not None:
        return _on_cluster(task, job, todo, client, progress)
    needed = job.bytes_needed()
    fit = int(MAX_MEMORY_FRACTION * free_bytes() // needed)
    if fit < 1:
        raise _too_large(job, needed, MAX_MEMORY_FRACTION * free_bytes())
    threads = min(workers or cores(), len(todo), fit)
    job = Job(job.store, job.source, max(1, (workers or cores()) // threads))
    _ = job.reach  # once, and not in each thread
    return in_threads(partial(task, job), todo, threads, progress)


def _too_large(job: Job, needed: float, free: float) -> InputError:
    reach = " x ".join(map(str, (job.reach[1] - job.reach[0]).tolist()))
    return InputError(
        "tile",
        f"is {' x '.join(map(str, job.store.tile))} cells, which with the {reach} cells that the robot reaches around "
        f"it takes {bytes_text(needed)} of memory",
        f"a task may take {bytes_text(free)}",
        "use a smaller tile, or workers with more memory",
        value=job.store.tile,
    )


class _Task:
    """A task as a worker has it, which opens the store once."""

    def __init__(self, task: Callable[[Job, Index], Any], path: str, source: Source) -> None:
        self._task, self._path, self._source = task, path, source

    @cached_property
    def job(self) -> Job:
        return Job(Store.open(self._path), self._source)

    def __call__(self, index: Index) -> Any:
        return self._task(self.job, index)


@lru_cache(1)
def _task_of(content: bytes) -> _Task:
    """The task that was sent."""
    try:
        task: _Task = pickle.loads(content)
    except OSError as error:
        rule = "all machines must see the folders of the workspace and of the store"
        hint = "put them into a folder that is shared, or build without a client"
        problem = f"cannot be read where tiles are made: {error.strerror or error}"
        raise FileError(str(error.filename or "the workspace"), problem, rule, hint) from error
    return task


def perform(content: bytes, index: Index) -> Any:
    """What a task that was sent gives for a tile; called where the version of cspace is that of the sender."""
    try:
        return _task_of(content)(index)
    except CspaceError as error:
        # What it came from may be anything, and cannot always be sent back.
        error.__cause__ = error.__context__ = None
        raise


def _other_version(versions: set[Any]) -> CspaceError:
    names = ", ".join(sorted("none" if version is None else str(version) for version in versions))
    return InputError(
        "client",
        f"has workers with cspace {names}",
        f"all must have cspace {__version__}, as this process has",
        "install it where the workers run, and start them again",
        value=versions,
    )


def _lost(what: str) -> CspaceError:
    return InputError(
        "client",
        f"lost its scheduler or its workers ({what})",
        "tiles are made on the workers of a cluster that runs",
        "start it again, and run the same again: what is done is kept",
    )


def _on_cluster(
    task: Callable[[Job, Index], Any],
    job: Job,
    todo: Sequence[Index],
    client: Any,
    progress: Callable[[int], None] | None,
) -> list[Any]:
    """As :func:`run`, on a cluster, whose scheduler is given some of the tasks at a time."""
    distributed = import_optional("distributed", CLUSTER, "distributed")

    # A worker goes down with what it cannot unpickle. So these two functions, which are sent as they stand, ask first
    # whether there is a cspace, and which one, by the name that every version has; and all else is sent as bytes.

    def version_there() -> str | None:
        try:
            return str(import_module("cspace").__version__)
        except ImportError:
            return None

    def room(dask_worker: Any) -> tuple[str | None, Any]:
        limit = getattr(dask_worker.memory_manager, "memory_limit", None)
        return version_there(), limit and limit / max(1, dask_worker.state.nthreads)

    def call(index: Index, content: bytes, version: str) -> tuple[str | None, Any]:
        version_here = version_there()
        if version_here != version:
            return version_here, None
        from cspace.tiles.work import perform

        return version_here, perform(content, index)

    futures: dict[Any, int] = {}
    results: list[Any] = [None] * len(todo)
    try:
        answers = client.run(room).values()
        if not answers:
            raise InputError(
                "client", "has no workers", "tiles are made on them", "start some, e.g. dask worker ADDRESS"
            )
        if {version for version, _ in answers} != {__version__}:
            raise _other_version({version for version, _ in answers})
        free, needed = min((limit for _, limit in answers if limit), default=0), job.bytes_needed()
        if free and needed > free:
            raise _too_large(job, needed, free)
        sent: Any = pickle.dumps(_Task(task, str(job.store.path.resolve()), job.source))
        if len(sent) > SMALL:
            # To all workers: what a single one has is lost with it.
            sent = client.scatter(sent, hash=False, broadcast=True)
        waiting = iter(enumerate(todo))
        running = distributed.as_completed([])
        done, since = 0, (began := time.monotonic())
        while done < len(todo):
            if len(futures) < AHEAD and (more := dict(itertools.islice(waiting, AHEAD))):
                new = client.map(call, list(more.values()), content=sent, version=__version__, pure=False, retries=3)
                futures.update(zip(new, more, strict=True))
                running.update(new)
            batch = running.next_batch(block=False)
            for future, (version, result) in zip(batch, client.gather(batch) if batch else (), strict=True):
                if version != __version__:  # of one that came later
                    raise _other_version({version})
                results[futures.pop(future)] = result
                done, since = done + 1, time.monotonic()
                if progress is not None:
                    progress(done)
            if time.monotonic() - since > PATIENCE and not client.scheduler_info()["workers"]:
                raise _lost(f"none for {PATIENCE:g} s")
            share, least, most = PAUSE
            time.sleep(min(max(share * (time.monotonic() - began), least), most))
        return results
    except CspaceError:
        raise
    except Exception as error:
        # What a client says of a scheduler that went away in the midst of its work may be anything.
        lost = distributed.scheduler.KilledWorker, distributed.CancelledError, OSError, TimeoutError
        if isinstance(error, lost) or client.status != "running":
            raise _lost(f"{type(error).__name__}: {error}") from error
        raise
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.cancel(list(futures))
