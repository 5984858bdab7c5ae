"""Tasks over tiles, in threads or on a cluster of dask."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from cspace import __version__
from cspace.errors import CspaceError, InputError, import_optional
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.threads import cores, in_threads
from cspace.tiles.folder import Index

if TYPE_CHECKING:
    from distributed import Client

DASK_USE: Final = "it runs tasks on the workers of a cluster"
"""Why dask is needed, for the error if it is not installed."""

TASK_RETRIES: Final = 3
"""Number of times that a task runs again after its worker was lost."""

Task = Callable[[Any, Index], Any]
"""Function of what all tasks share, and of the index of a tile."""

Progress = Callable[[int], None]
"""Function that is called with the number of finished tasks."""


def run_tasks(
    task: Task,
    shared: Any,
    tiles: Sequence[Index],
    needed: float,
    client: Client | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> list[Any]:
    """Return ``task(shared, tile)`` for each tile, run in threads or on a cluster.

    ``needed`` is the memory of one task, in bytes. Raises InputError if that exceeds the memory,
    CspaceError if the cluster fails, and any error of a task.
    """
    if not tiles:
        return []
    if client is not None:
        return _run_on_cluster(task, shared, tiles, needed, client, progress)
    free = MAX_MEMORY_FRACTION * free_bytes()
    _check_memory(needed, free)
    threads = min(workers or cores(), len(tiles), int(free // needed))
    return in_threads(partial(task, shared), tiles, threads, progress)


def _check_memory(needed: float, free: float) -> None:
    """Raise InputError if a task exceeds the memory of a worker."""
    if needed > free:
        problem = f"is so large that a task needs {bytes_text(needed)}"
        rule = f"{bytes_text(free)} are available"
        hint = "use a smaller tile, or workers with more memory"
        raise InputError("tile", problem, rule, hint, value=needed)


def _run_on_cluster(
    task: Task,
    shared: Any,
    tiles: Sequence[Index],
    needed: float,
    client: Any,
    progress: Progress | None,
) -> list[Any]:
    """Return the results of tasks that run on the workers of a cluster."""
    distributed = import_optional("distributed", DASK_USE, "distributed")
    results: dict[Index, Any] = {}
    futures: dict[Any, Index] = {}
    try:
        _check_workers(client, needed)
        # Every worker gets a copy and keeps it for all its tasks.
        given = client.scatter(shared, hash=False, broadcast=True)
        made = client.map(_run_task, list(tiles), task=task, shared=given, pure=False, retries=TASK_RETRIES)
        futures.update(zip(made, tiles, strict=True))
        for future, result in distributed.as_completed(made, with_results=True):
            if future.status != "finished":  # the scheduler has died
                raise TimeoutError(f"a task was {future.status}")
            results[futures[future]] = result
            if progress is not None:
                progress(len(results))
        return [results[tile] for tile in tiles]
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
            client.cancel(list(futures))


def _run_task(index: Index, task: Task, shared: Any) -> Any:
    """Run a task on a worker."""
    try:
        return task(shared, index)
    except CspaceError as error:
        # The cause may be of any class, and not every class can be pickled.
        error.__cause__ = error.__context__ = None
        raise


def _check_workers(client: Any, needed: float) -> None:
    """Raise InputError if a worker has another version of cspace, or too little memory."""

    # Sent by value, because a worker may lack this module.
    def describe_worker(dask_worker: Any) -> tuple[str, Any]:
        limit = getattr(dask_worker.memory_manager, "memory_limit", None)
        try:
            version = str(import_module("cspace").__version__)
        except ImportError:
            version = "none"
        return version, limit and limit / max(1, dask_worker.state.nthreads)

    answers = list(client.run(describe_worker).values())
    if not answers:
        raise InputError("client", "has no workers", "tasks run on them", "start one, e.g. dask worker")
    versions = {version for version, _ in answers}
    if versions != {__version__}:
        problem = f"has workers with cspace {', '.join(sorted(versions))}"
        rule = f"all must have cspace {__version__}, like this process"
        raise InputError("client", problem, rule, "install it there and restart them", value=versions)
    limits = [limit for _, limit in answers if limit]
    if limits:
        _check_memory(needed, min(limits))
