"""Report of a run: figures, notes and failed checks."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks.timing import Timing

INSTALLED_BY = {
    "cv2": "opencv-python-headless",
    "fcl": "python-fcl",
    "pinocchio": "pin",
    "pydrake": "drake",
    "vamp": "vamp-planner",
}
"""Distributions whose name differs from their package."""

REPORTED_PACKAGES = (
    "cspace",
    "numpy",
    "scipy",
    "numba",
    "shapely",
    "ompl",
    "opencv-python-headless",
)


class Report:
    """Figures, notes and failed checks, printed at once and saved later.

    Parameters
    ----------
    quick : bool
        Whether the run has smaller sizes and fewer repetitions than the targets assume.
    command : str
        The command of this run.
    folder : Path, optional
        Folder for pictures.
    """

    def __init__(self, quick: bool, command: str = "", folder: Path | None = None) -> None:
        self.quick = quick
        self.folder = folder
        self.command = command
        self.benchmark = ""
        self.case = ""
        self.rows: list[dict[str, Any]] = []
        self.notes: list[str] = []
        self.failures: list[str] = []
        self.machine = machine()
        print("; ".join(f"{key} {value}" for key, value in self.machine.items()))

    def start(self, benchmark: str) -> None:
        """Begin another benchmark."""
        self.benchmark = benchmark
        print(f"\n== {benchmark}{' (quick)' if self.quick else ''}", flush=True)

    def section(self, case: str) -> None:
        """Begin another case, named by its sizes."""
        self.case = case
        print(f"\n{case}", flush=True)

    def note(self, text: str) -> None:
        """Print and store a note."""
        self.notes.append(f"{self.benchmark}: {text}")
        print(f"  {text}", flush=True)

    def timing(self, name: str, timing: Timing, **more: Any) -> None:
        """Report the median time of a call and its spread."""
        low, high = min(timing.seconds), max(timing.seconds)
        cpu = timing.median_cpu if timing.cpu else None
        figures = {
            "median_s": timing.median,
            "min_s": low,
            "max_s": high,
            "cpu_s": cpu,
            "runs": len(timing.seconds),
        }
        self._row(name, {**figures, **more})
        spread = f"({time_text(low)} to {time_text(high)}, {len(timing.seconds)} runs"
        spread += ")" if cpu is None else f"; cpu {time_text(cpu)})"
        extra = "".join(f", {key.replace('_', ' ')} {value}" for key, value in more.items())
        print(f"  {name:<58}{time_text(timing.median):>10}  {spread}{extra}", flush=True)

    def timings(self, timings: Mapping[str, Timing]) -> None:
        """Report several timings."""
        for name, timing in timings.items():
            self.timing(name, timing)

    def has(self, package: str, without: str = "skipped") -> bool:
        """Return True if a package can be imported; otherwise add a note."""
        if not is_here(package):
            self.note(
                f"{without}: {package} is not installed; pip install {INSTALLED_BY.get(package, package)}"
            )
        return is_here(package)

    def figure(
        self,
        name: str,
        value: float,
        unit: str = "x",
        least: float | None = None,
        most: float | None = None,
    ) -> None:
        """Report a number beside its target, ``least`` or ``most``, for full sizes.

        A missed target is printed but is not a failure.
        """
        if self.quick:
            least = most = None
        bound = least if least is not None else most
        verdict = None
        target = ""
        if bound is not None:
            verdict = value >= bound if least is not None else value <= bound
            side = "least" if least is not None else "most"
            target = f"  target: at {side} {bound:g}, {'met' if verdict else 'MISSED'}"
        self._row(
            name, {"value": value, "unit": unit, "least": least, "most": most, "met": verdict}
        )
        print(f"  {name:<58}{f'{number_text(value)} {unit}':>10}{target}", flush=True)

    def ratio(
        self,
        name: str,
        over: Timing,
        under: Timing,
        least: float | None = None,
        most: float | None = None,
    ) -> None:
        """Report the ratio of two timings, by wall time and by CPU time.

        Other work on the machine disturbs CPU time less, and threads do not lower it.
        """
        self.figure(name, over.median / under.median, least=least, most=most)
        self.mark(over_s=over.median, under_s=under.median, runs=len(over.seconds))
        if over.cpu and under.cpu and under.median_cpu > 0.0:
            self.mark(cpu_value=(cpu := over.median_cpu / under.median_cpu))
            print(f"  {'    in CPU time':<58}{f'{cpu:.3g} x':>10}", flush=True)

    def check(self, holds: bool, claim: str) -> None:
        """Report a claim about the results; a false claim fails the run."""
        self._row(claim, {"holds": bool(holds)})
        print(f"  {'ok  ' if holds else 'FAIL'} {claim}", flush=True)
        if not holds:
            self.failures.append(f"{self.benchmark}: {self.case}: {claim}")

    def mark(self, **values: Any) -> None:
        """Store more values of the last row without printing them."""
        self.rows[-1] |= values

    def write(self, path: Path) -> None:
        """Save the report as JSON."""
        write_whole(path, json.dumps(self.whole(), indent=1).encode() + b"\n")

    def whole(self) -> dict[str, Any]:
        """Return all figures, notes and failures."""
        about = {"command": self.command, "machine": self.machine, "quick": self.quick}
        return {**about, "failures": self.failures, "notes": self.notes, "rows": self.rows}

    def _row(self, name: str, values: dict[str, Any]) -> None:
        self.rows.append({"benchmark": self.benchmark, "case": self.case, "name": name, **values})


@cache
def is_here(package: str) -> bool:
    """Return True if a package can be imported."""
    try:
        import_module(package)
    except ImportError:
        return False
    return True


def write_whole(path: Path, content: bytes) -> None:
    """Write a file atomically."""
    part = path.with_name(path.name + ".part")
    part.write_bytes(content)
    part.replace(path)


def machine() -> dict[str, str]:
    """Return versions and the number of usable cores."""
    from cspace._support.threads import count_cores

    about = {"cores": str(count_cores()), "system": f"{platform.system()} {platform.machine()}"}
    about["python"] = platform.python_version()
    for name in REPORTED_PACKAGES:
        try:
            about[name] = version(name)
        except PackageNotFoundError:
            about[name] = "source tree" if name == "cspace" else "missing"
    return about


def time_text(seconds: float) -> str:
    """Format a time with a suitable unit."""
    for scale, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "us")):
        if seconds >= scale:
            return f"{number_text(seconds / scale)} {unit}"
    return f"{seconds * 1e9:.3g} ns"


def number_text(value: float) -> str:
    """Format a number with three digits or as an integer."""
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
