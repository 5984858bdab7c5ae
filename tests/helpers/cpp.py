"""The C++ header: compiled programs, queries near borders, and answers to compare with Python's."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import cspace
from tests.helpers.placements import draw_configurations, move
from tests.helpers.repository import ROOT

WARNINGS = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror")
SANITIZERS = ("-fsanitize=address,undefined", "-fsanitize=float-cast-overflow")
SOURCE = ROOT / "tests" / "cpp" / "answers.cpp"

Rng = np.random.Generator
Floats = NDArray[np.float64]


@cache
def why_no_compiler() -> str:
    """Return why C++ cannot be compiled here; "" if it can."""
    if shutil.which("g++") is None:
        return "no g++ is here; install g++ and libzstd-dev to test the C++ header"
    program = "#include <zstd.h>\nint main() { return ZSTD_versionNumber() == 0; }\n"
    command = ["g++", "-x", "c++", "-", "-o", "/dev/null", "-lzstd"]
    done = subprocess.run(command, input=program, text=True, capture_output=True, check=False)
    return "no libzstd is here; install libzstd-dev" if done.returncode else ""


@cache
def ompl_flags() -> list[str]:
    """Return the compiler's flags for OMPL; empty if it is not here."""
    if shutil.which("pkg-config") is None:
        return []
    command = ["pkg-config", "--cflags-only-I", "ompl", "eigen3"]
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    # Warnings of OMPL's own headers are not ours. Its libraries also name parts of Boost that are not needed.
    folders = done.stdout.replace("-I", "-isystem").split()
    return [*folders, "-lompl"] if done.returncode == 0 else []


def build_program(
    target: Path, *flags: str, source: Path = SOURCE, zstd: bool = True, own: bool = True
) -> Path:
    """Compile a program over the header, with every warning an error.

    Without ``own``, the flags name the folder of another header.
    """
    command = ["g++", *WARNINGS, str(source), "-o", str(target), *flags]
    if own:
        command += ["-I", cspace.get_include()]
    if zstd:
        command += ["-DCSPACE_ZSTD", "-lzstd"]
    done = subprocess.run([*command, "-pthread"], text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return target


# ---- maps ----------------------------------------------------------------------------------------


BAR, BOX = cspace.Robot.rectangle(0.5, 0.2), cspace.Robot.box((0.4, 0.2, 0.1))
WEDGE = cspace.Robot.polygon([(0, 0), (0.4, 0), (0, 0.2)])
BORDERS = [-1.0, 0.3, 1.1, 2.0, 4.0, 2.0 * np.pi - 1.0]

SPACES: dict[str, tuple[tuple[int, ...], cspace.Robot, Any]] = {
    "R2": ((70, 50), BAR, None),
    "SE2": ((60, 50), WEDGE, 16),
    "SE2 shared": ((60, 50), BAR, 16),
    "SE2 uneven": ((60, 50), WEDGE, BORDERS),
    "SE2 one cell": ((40, 30), cspace.Robot.disc(0.1), 1),
    "R3": ((20, 18, 22), BOX, None),
    "R3 yaw": ((20, 18, 22), BOX, 6),
    "SE3": ((16, 14, 15), BOX, cspace.Rotations.quaternions(4)),
    "SE3 coarse": ((9, 8, 7), BOX, cspace.Rotations.quaternions(1)),
}
"""Shape of the workspace, robot and rotation cells of a map of each space."""


def build_space(name: str, outside: str) -> cspace.CSpace:
    """Build a map of one of ``SPACES`` away from the origin, always the same."""
    shape, robot, rotations = SPACES[name]
    rng = np.random.default_rng(0)
    cells = np.zeros(shape, dtype=np.bool_)
    cells.flat[rng.choice(cells.size, 1 + cells.size // 200, replace=False)] = True
    workspace = cspace.Workspace.from_array(cells, 0.1, lower=(-1.3, 0.7, 0.2)[: len(shape)])
    return cspace.build(workspace, robot, rotations=rotations, outside=outside)


# ---- queries -------------------------------------------------------------------------------------


def draw_queries(space: Any, n: int, rng: Rng) -> Floats:
    """Draw pairs of configurations near borders of cells, as rows, shape (n, 2 size).

    Many motions are short, or turn by nearly half a turn.
    """
    dim = space.grid.dim
    starts = draw_configurations(space, rng, n, far=True)
    steps = rng.normal(size=(n, dim)) * space.grid.spacing * 10.0 ** rng.uniform(-9, 1.7, (n, 1))
    steps *= rng.random((n, dim)) < 0.8
    axes = rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    angles = rng.choice([0.0, 1e-9, 1e-4, 0.1, 1.0, np.pi], (n, 1))
    moved = move(space, starts, steps, angles * axes)
    ends = np.where(rng.random((n, 1)) < 0.7, moved, draw_configurations(space, rng, n))
    queries = np.hstack([starts, ends])
    queries += rng.integers(-2, 3, queries.shape) * np.spacing(queries)
    return queries + rng.choice([0.0, 0.0, 1e-9, -3e-9], queries.shape)


# ---- answers -------------------------------------------------------------------------------------


def run_program(program: Path, *arguments: object) -> list[str]:
    """Return the lines that a program prints."""
    command = [str(program), *map(str, arguments)]
    done = subprocess.run(command, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def answers_of(
    program: Path, map_: Path, queries: Floats, *options: str
) -> tuple[NDArray[np.uint8], NDArray[np.bool_], Floats]:
    """Return the states of the first configurations, the motions, and clearances, from C++."""
    rows, answers = map_.parent / "queries.bin", map_.parent / "answers.bin"
    rows.write_bytes(np.ascontiguousarray(queries).tobytes())
    run_program(program, "query", map_, rows, answers, *options)
    content, n = answers.read_bytes(), len(queries)
    states, motions = np.frombuffer(content[: 2 * n], np.uint8).reshape(2, n)
    return states, motions == 1, np.frombuffer(content[2 * n :])


def count_differences(
    space: cspace.CSpace, program: Path, map_: Path, queries: Floats, *options: str
) -> dict[str, int]:
    """Count the answers of C++ that differ from those of a map in memory, by kind."""
    first, last = np.split(queries, 2, axis=1)
    states, motions, clearances = answers_of(program, map_, queries, *options)
    expected = space.motion_is_free(first, last)
    differences = {
        "states": int(np.count_nonzero(states != space.classify(first))),
        "motions": int(np.count_nonzero(motions != expected)),
        "motions that are free": int(np.count_nonzero(expected)),
    }
    if (map_ / "distances").exists():
        differences["clearances"] = int(np.count_nonzero(clearances != space.clearance(first)))
    return differences


def count_prefixes(program: Path, map_: Path, chunks: Floats, tracking: Any) -> list[str]:
    """Return the number of proven rows of chunks, shape (b, n, size), or the text of an error."""
    rows = map_.parent / "chunks.bin"
    rows.write_bytes(np.ascontiguousarray(chunks).tobytes())
    numbers = map(float, tracking)
    return run_program(program, "prefix", map_, rows, chunks.shape[1], *numbers)


def slow_in_cpp(
    program: Path, map_: Path, rows: Floats, robot: str, *numbers: float, leaving: bool = False
) -> list[str]:
    """Return a line for each slowed twist; ``rows`` are poses, wanted and present twists.

    ``robot`` has the cores as the program reads them; numbers are the seconds of a command, brakes,
    tracking, and the radius of points.
    """
    file = map_.parent / "twists.bin"
    file.write_bytes(np.ascontiguousarray(rows).tobytes())
    return run_program(program, "slow", map_, file, int(leaving), robot, *map(float, numbers))


class Program:
    """A running C++ program that is told lines."""

    def __init__(self, command: list[Any], log: Path | None = None) -> None:
        """Start the program; what it logs goes to a file, if there is one."""
        pipe = subprocess.PIPE
        self.log_file = log
        with contextlib.nullcontext() if log is None else log.open("w") as stderr:
            self.process = subprocess.Popen(
                list(map(str, command)), stdin=pipe, stdout=pipe, stderr=stderr, text=True
            )

    def tell(self, *words: Any) -> None:
        """Send a line."""
        print(*words, file=self.process.stdin, flush=True)

    def read_line(self) -> str:
        """Return the next line of the program."""
        assert self.process.stdout is not None
        return self.process.stdout.readline().strip()

    def read_log(self) -> str:
        """Return what the program has logged."""
        assert self.log_file is not None
        return self.log_file.read_text(encoding="utf-8")

    def close(self) -> str:
        """End the program; return what it still says."""
        rest, _ = self.process.communicate()
        assert self.process.returncode == 0
        return rest


class GateInCpp(Program):
    """A gate of a running C++ program; it answers one situation at a time."""

    def __init__(
        self, program: Path, map_: Path, robot: str, *numbers: float, leaving: bool = False
    ) -> None:
        """Start the program; the arguments are those of :func:`slow_in_cpp`."""
        super().__init__([program, "drive", map_, int(leaving), robot, *map(float, numbers)])

    def slow_down(self, pose: Any, twist: Any, now: Any, points: Any = ()) -> SlowedInCpp:
        """Return what the gate lets through; the third number of a twist is its side."""
        twists = np.zeros((2, 3))
        twists[:, : len(twist)] = twist, now
        self.tell(*map(float, (*pose, *np.ravel(twists), *np.ravel(points))))
        return read_slowed(self.read_line(), len(twist))


class SlowedInCpp(NamedTuple):
    """What a gate in C++ lets through."""

    share: float
    is_proven: bool
    leaves: bool
    commands: Floats


def read_slowed(line: str, size: int = 2) -> SlowedInCpp:
    """Read a line of the program; ``size`` is that of each command."""
    share, is_proven, leaves, *numbers = map(float, line.split())
    return SlowedInCpp(share, bool(is_proven), bool(leaves), np.reshape(numbers, (-1, 3))[:, :size])


def open_in_cpp(program: Path, *maps: Path) -> list[str]:
    """Open maps in C++ and query them; return "opened" or the text of the error of each."""
    command = [str(program), "open", *map(str, maps)]
    done = subprocess.run(command, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    # Errors cite damaged texts, which may be no UTF-8, or break lines.
    return done.stdout.decode(errors="replace").split("\n")[:-1]
