"""Tasks over tiles, in threads or on a cluster of dask."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import cspace
from cspace import Grid
from cspace.errors import InputError
from cspace.inside import check_memory, count_cores, map_in_threads

if TYPE_CHECKING:
    from distributed import Client

Task = Callable[[int], Any]
"""Function that takes the index of a tile."""

Progress = Callable[[int, int], None]
"""Function that takes the number of finished tiles, and of all tiles."""


def run_tasks(
    task: Task,
    tiles: Sequence[int],
    needed: float,
    grid: Grid,
    client: Client | None,
    workers: int | None,
    progress: Progress | None,
) -> list[Any]:
    """Return ``[task(tile) for tile in tiles]`` from threads or a cluster.

    ``needed`` is the memory of one task, in bytes, and ``grid`` are its cells; as many threads run
    as fit into memory. Raises InputError if one does not fit, or if the cluster fails, and any
    error of a task.
    """

    def advance(count: int) -> None:
        """Report the number of finished tiles."""
        if progress is not None:
            progress(count, len(tiles))

    if client is not None:
        return _run_on_cluster(task, tiles, client, advance)
    check_memory(needed, "tile", grid)
    threads = min(workers or count_cores(), len(tiles))
    while threads > 1 and not _fits(threads * needed, grid):
        threads -= 1
    return map_in_threads(task, tiles, threads, advance)


def _fits(needed: float, grid: Grid) -> bool:
    """Return True if work on cells fits into memory."""
    try:
        check_memory(needed, "tile", grid)
    except InputError:
        return False
    return True


def _run_on_cluster(
    task: Task, tiles: Sequence[int], client: Any, advance: Callable[[int], None]
) -> list[Any]:
    """Return results of tasks on a cluster's workers."""
    _check_workers(client)
    # Every worker gets one copy of the task for all tiles. Tasks of a lost worker run again.
    copies = client.scatter(task, hash=False, broadcast=True)
    futures = client.map(_run_task, list(tiles), task=copies, pure=False, retries=3)
    try:
        # With one thread, this thread waits for the results in order, and reports progress.
        return map_in_threads(lambda future: future.result(), futures, 1, advance)
    except (CancelledError, TimeoutError) as error:
        problem = f"lost its scheduler or its workers ({type(error).__name__}: {error})"
        raise InputError(
            "client", problem, "the cluster must be running; finished tiles are kept"
        ) from error
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.cancel(futures)


def _run_task(tile: int, task: Task) -> Any:
    """Run a task on a worker.

    Its arguments are in the order that ``client.map`` needs.
    """
    return task(tile)


def _check_workers(client: Any) -> None:
    """Raise InputError unless there are workers, all with this version of cspace."""
    workers = client.get_versions(packages=["cspace"])["workers"].values()
    versions = {str(worker["packages"]["cspace"]) for worker in workers}
    if versions != {cspace.__version__}:
        problem = f"workers with cspace {', '.join(sorted(versions))}" if versions else "no workers"
        rule = f"all must have cspace {cspace.__version__}, like this process"
        raise InputError("client", f"has {problem}", rule)
