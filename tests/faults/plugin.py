"""Plugin of pytest that collects once, and tests each fault in a fork of that process."""

from __future__ import annotations

import json
import os
import signal
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from resource import RLIMIT_CPU, setrlimit
from typing import NamedTuple

import pytest

from tests.faults import hook

RESULTS = "CSPACE_FAULTS_RESULTS"
"""Environment variable that names the file of results: by fault, how many tests reach it, and the first that fails."""

MIN_SECONDS = 30.0
"""Least CPU time that the tests of a fault have."""


class Run(NamedTuple):
    """A test without a fault awake."""

    test: str
    failed: bool
    reached: Sequence[int]
    prepared: Sequence[int]  # by fixtures, which may be shared by the tests of a file
    seconds: float


_failed: list[str] = []
_prepared: list[int] = []


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note failures."""
    if report.failed:
        _failed.append(report.nodeid)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> object:
    """Note the faults that fixtures reach."""
    result = yield
    _prepared[:] = hook.take_reached()
    return result


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session: pytest.Session) -> bool:
    """Run all tests once, then for each fault those that reach it, cheapest first."""
    items = session.items
    done = run_in_fork(lambda: [_run_item(items, k) for k in range(len(items))], 3600.0)
    runs = [Run(*each) for each in done or ()]
    print(f"{len(runs)} tests, {sum(run.seconds for run in runs):.0f} s of CPU", flush=True)
    failing = [run.test for run in runs if run.failed]
    if failing or not runs:
        print(f"fail without a fault: {', '.join(failing) or 'all'}", flush=True)
    places = {item.nodeid: k for k, item in enumerate(items)}
    numbers = json.loads(Path(os.environ[hook.PLAN]).read_text(encoding="utf-8"))
    results = {}
    for number in sorted(n for each in numbers.values() for n in each.values()):
        files = {_name_file(run.test) for run in runs if number in run.prepared}
        reaching = [
            run
            for run in runs
            if not run.failed and (number in run.reached or _name_file(run.test) in files)
        ]
        reaching.sort(key=lambda run: run.seconds)
        chosen = [items[places[run.test]] for run in reaching]
        seconds = max(3.0 * sum(run.seconds for run in reaching), MIN_SECONDS)
        found = run_in_fork(lambda n=number, some=chosen: [_find_failing(n, some)], seconds)
        # A fork that dies or does not end is noticed, too.
        first = (found or ["died, or did not end"])[0]
        results[number] = len(reaching), first
        print(end="." if first else "s", flush=True)
    Path(os.environ[RESULTS]).write_text(json.dumps(results), encoding="utf-8")
    print(flush=True)
    return True


def _name_file(test: str) -> str:
    """Return the file of a test."""
    return test.partition("::")[0]


def _run_item(items: Sequence[pytest.Item], k: int) -> Run:
    """Run a test; note the faults that it reaches."""
    before = sum(os.times()[:4])
    _failed.clear()
    _prepared.clear()
    following = items[k + 1] if k + 1 < len(items) else None
    items[k].config.hook.pytest_runtest_protocol(item=items[k], nextitem=following)
    reached = hook.take_reached()
    seconds = sum(os.times()[:4]) - before
    return Run(items[k].nodeid, bool(_failed), reached, tuple(_prepared), seconds)


def _find_failing(number: int, items: Sequence[pytest.Item]) -> str:
    """Run tests with a fault awake; return the first that fails, or nothing."""
    hook.wake(number)
    for k in range(len(items)):
        run = _run_item(items, k)
        if run.failed:
            return run.test
    return ""


def run_in_fork(work: Callable[[], list[object]], cpu_seconds: float) -> list[object] | None:
    """Run a function in a fork; return its result, or None if that died or did not end."""
    with tempfile.NamedTemporaryFile(prefix="cspace-fault-") as file:
        process = os.fork()
        if not process:
            os.setpgid(0, 0)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            setrlimit(RLIMIT_CPU, (int(cpu_seconds), int(cpu_seconds) + 5))
            with suppress(BaseException):
                Path(file.name).write_text(json.dumps(work()), encoding="utf-8")
            os._exit(0)
        deadline = time.monotonic() + 4.0 * cpu_seconds
        while not os.waitpid(process, os.WNOHANG)[0]:
            if time.monotonic() > deadline:
                os.killpg(process, signal.SIGKILL)
            time.sleep(0.005)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process, signal.SIGKILL)  # its children
        text = Path(file.name).read_text(encoding="utf-8")
    return json.loads(text) if text else None
