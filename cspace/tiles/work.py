"""Tasks over tiles, in threads or on a cluster of dask."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from cspace import __version__
from cspace.errors import CspaceError, InputError, import_optional
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.support.threads import cores, in_threads
from cspace.tiles.folder import Index

if TYPE_CHECKING:
    from distributed import Client

DASK_USE: Final = "it runs tasks on the workers of a cluster"
"""Why dask is needed, for the error if it is not installed."""

TASK_RETRIES: Final = 3
"""Number of times that a task runs again after its worker was lost."""

Task = Callable[[Index], Any]
"""Function of the index of a tile."""

Progress = Callable[[int, int], None]
"""Function that is called with the number of finished tiles, and of all tiles."""


def run_tasks(
    task: Task,
    tiles: Sequence[Index],
    total: int,
    needed: float,
    client: Client | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Any]:
    """Return ``task(tile)`` for each tile, run in threads or on a cluster.

    All other tiles of ``total`` count as finished. ``needed`` is the memory of one task, in bytes;
    threads are as many as fit. Raises InputError if one does not fit, or if the cluster fails, and
    any error of a task.
    """
    if not tiles:
        return []

    def advance(count: int) -> None:
        if progress is not None:
            progress(total - len(tiles) + count, total)

    if client is not None:
        return _run_on_cluster(task, tiles, client, advance)
    available = MAX_MEMORY_FRACTION * free_bytes()
    if needed > available:
        problem = f"is so large that a task needs {bytes_text(needed)}"
        rule = f"{bytes_text(available)} are available"
        raise InputError("tile", problem, rule, "use a smaller tile or fewer rotations")
    threads = min(workers or cores(), int(available // needed))
    return in_threads(task, tiles, threads, advance)


def _run_on_cluster(
    task: Task, tiles: Sequence[Index], client: Any, advance: Callable[[int], None]
) -> list[Any]:
    """Return the results of tasks that run on the workers of a cluster."""
    distributed = import_optional("distributed", DASK_USE, "distributed")
    futures: list[Any] = []
    try:
        _check_workers(client)
        # Every worker gets a copy and keeps it for all its tasks.
        copies = client.scatter(task, hash=False, broadcast=True)
        futures = client.map(_run_task, list(tiles), task=copies, pure=False, retries=TASK_RETRIES)
        results = []
        for future in futures:
            results.append(future.result())
            advance(len(results))
        return results
    except CspaceError:
        raise
    except (Exception, asyncio.CancelledError) as error:  # of any class if the scheduler dies
        lost = distributed.scheduler.KilledWorker, asyncio.CancelledError, OSError, TimeoutError
        if isinstance(error, lost) or client.status != "running":
            problem = f"lost its scheduler or its workers ({type(error).__name__}: {error})"
            hint = "restart it and repeat the call: finished tiles are kept"
            raise InputError("client", problem, "the cluster must be running", hint) from error
        raise
    finally:
        with suppress(Exception):  # the scheduler may be gone
            client.cancel(futures)


def _run_task(index: Index, task: Task) -> Any:
    """Run a task on a worker."""
    try:
        return task(index)
    except CspaceError as error:
        # The cause may be of any class, and not every class can be pickled.
        error.__cause__ = error.__context__ = None
        raise


def _check_workers(client: Any) -> None:
    """Raise InputError unless there are workers, all with this version of cspace."""

    # Sent by value, because a worker may lack this module.
    def find_version() -> str:
        try:
            return str(import_module("cspace").__version__)
        except ImportError:
            return "none"

    versions = set(client.run(find_version).values())
    if versions != {__version__}:
        found = f"workers with cspace {', '.join(sorted(versions))}" if versions else "no workers"
        rule = f"all must have cspace {__version__}, like this process"
        raise InputError("client", f"has {found}", rule, "install it there and start workers")
