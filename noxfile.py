"""The project's tasks: ``nox --list`` shows them, and ``nox -s lint`` runs one.

Each Python has its own environment for the tests. All other tasks run in the environment that nox is installed in.
"""

import os
import platform
import shutil
import sys
import tempfile
from functools import partial
from pathlib import Path

import nox

PYTHON = sys.executable
"""The Python that nox runs with, and whose environment the tasks without one of their own use."""

PYTHONS = ["3.11", "3.12", "3.13"]
"""The Pythons that the tests run on."""

PLATFORM = "manylinux_2_27_x86_64.manylinux_2_28_x86_64"
"""Tag of the systems for compiled code: those of numba's wheels. The code calls no library beside numba's."""

ROS_PACKAGES = ["rclpy", "nav-msgs", "visualization-msgs", "trajectory-msgs", "rmw-fastrtps-cpp"]
ROS_PACKAGES += ["ament-cmake", "ament-cmake-include-directories", "ament-package"]
"""Wheels of ROS 2 that its tests need, in an environment of their own; the last ones build packages."""

ROS_NUMPY = "numpy==1.26.4"
"""The numpy of Ubuntu 24.04, for which Jazzy's messages are compiled."""

NEED_NUMPY_2 = ("numpy=", "scipy=", "contourpy=", "numcodecs=")
"""Pins of constraints.txt that do not go with it."""

nox.options.sessions = ["lint", "test"]
nox.options.reuse_venv = "yes"


@nox.session(python=PYTHONS)
def test(session: nox.Session) -> None:
    """Run the tests on each Python, e.g. `nox -s test-3.12 -- tests/rotations`."""
    session.install("-c", "constraints.txt", "-e", ".[test]")
    session.run("python", "-m", "pytest", "-q", "--cpu", *session.posargs)


@nox.session(python=PYTHONS)
def newest(session: nox.Session) -> None:
    """Run the tests on each Python with the newest releases within the bounds of pyproject.toml."""
    session.install("--upgrade", "--upgrade-strategy", "eager", "-e", ".[test]")
    session.run("python", "-m", "pip", "list")
    session.run("python", "-m", "pytest", "-q", *session.posargs)


@nox.session(venv_backend="none")
def constraints(session: nox.Session) -> None:
    """Pin the newest releases in constraints.txt, for all Pythons and systems."""
    session.run(
        *(PYTHON, "-m", "uv", "pip", "compile", "pyproject.toml", "-o", "constraints.txt"),
        *("--quiet", "--universal", "--upgrade", "--no-annotate"),
        *(
            "--python-version",
            PYTHONS[0],
            "--extra",
            "dev",
            "--extra",
            "benchmark",
            "--extra",
            "formats",
        ),
        *("--custom-compile-command", "nox -s constraints"),
    )


@nox.session(python=PYTHONS)
def release(session: nox.Session) -> None:
    """Build the distributions in dist/, on Linux x86-64 also a wheel with compiled code for each Python; check them."""
    source = Path(__file__).resolve().parent
    run_tool = partial(session.run, PYTHON, "-m", external=True)
    run_tool("build", "--outdir", "dist", str(source))
    (wheel,) = source.glob("dist/*-none-any.whl")
    session.install("-c", "constraints.txt", wheel)
    made = [wheel, *source.glob("dist/*.tar.gz")]
    if (platform.system(), platform.machine()) == ("Linux", "x86_64"):
        made.append(_add_code(session, wheel))
    run_tool("twine", "check", "--strict", *map(str, made))
    wheels = [str(each) for each in made if each.suffix == ".whl"]
    run_tool("check_wheel_contents", *wheels)


def _add_code(session: nox.Session, wheel: Path) -> Path:
    """Build a wheel with compiled code from one without, which is installed, and check it installed."""
    tag = f"cp{str(session.python).replace('.', '')}"
    tags = ("--python-tag", tag, "--abi-tag", tag, "--platform-tag", PLATFORM)
    script = str(wheel.parents[1] / "tests/release.py")
    time = {"SOURCE_DATE_EPOCH": "1580601600"}  # hatchling's own
    run_tool = partial(session.run, PYTHON, "-m", external=True, env=time)
    with tempfile.TemporaryDirectory() as folder, session.chdir(folder):
        run_tool("wheel", "unpack", str(wheel))
        (unpacked,) = map(str, Path(folder).iterdir())
        session.run("python", script, "compile", unpacked, env={"PYTHONHASHSEED": "0"})
        run_tool("wheel", "pack", unpacked)
        (packed,) = map(str, Path(folder).glob("*.whl"))
        run_tool("wheel", "tags", "--remove", *tags, packed)
        (tagged,) = Path(folder).glob("*.whl")
        made = Path(shutil.copy(tagged, wheel.parent))
        session.install("--no-deps", "--force-reinstall", str(made))
        session.run("python", script, "check")
    return made


@nox.session(venv_backend="none")
def lint(session: nox.Session) -> None:
    """Check style, format, spelling, types, imports, dependencies and generated lists."""
    session.run(PYTHON, "-m", "ruff", "check")
    session.run(PYTHON, "-m", "ruff", "format", "--check")
    session.run(PYTHON, "-m", "codespell_lib")
    session.run(PYTHON, "-m", "mypy")
    session.run(PYTHON, "-m", "pytest", "-q", "-n0", "tests/lint")
    session.run(PYTHON, "-m", "tests.mutants", "--check")


@nox.session(venv_backend="none")
def docs(session: nox.Session) -> None:
    """Run the code of pages; build the documentation, which runs its tutorials and examples."""
    session.run(PYTHON, "-m", "pytest", "-q", "-n0", "tests/docs")
    session.run(
        PYTHON, "-m", "sphinx", "-W", "--keep-going", "docs", "docs/_build", *session.posargs
    )


@nox.session(venv_backend="none")
def bench(session: nox.Session) -> None:
    """Run benchmarks by name, e.g. `nox -s bench -- edges callbacks`; without a name, all of them, in small sizes."""
    session.run(PYTHON, "-m", "benchmarks", *(session.posargs or ["all", "--quick"]))


@nox.session(venv_backend="none")
def fuzz(session: nox.Session) -> None:
    """Compare new random cases with exact geometry, for an hour without arguments, e.g. `nox -s fuzz -- --quick maps`."""
    session.run(PYTHON, "-m", "tests.fuzz", *(session.posargs or ["--minutes", "60"]))


@nox.session(venv_backend="none")
def cpp(session: nox.Session) -> None:
    """Compile the C++ headers, the example for OMPL and the package for Nav2; `nox -s fuzz -- cpp` compares all answers."""
    session.run(PYTHON, "-m", "pytest", "-q", "-n0", "tests/cpp", *session.posargs)


@nox.session(venv_backend="none")
def core(session: nox.Session) -> None:
    """Run the core's tests on a copy of the core alone, e.g. `nox -s core -- -m ""`."""
    session.run(PYTHON, "-m", "tests.core", *session.posargs)


@nox.session(venv_backend="none")
def wing(session: nox.Session) -> None:
    """Run the tests of wings or of planners, with the contract of the inner door, e.g. `nox -s wing -- lanes`."""
    folders = [f"tests/{name}" for name in session.posargs]
    session.run(PYTHON, "-m", "pytest", "-q", *folders, "tests/test_inside.py")


@nox.session(python="3.12")
def ros(session: nox.Session) -> None:
    """Test the nodes of cspace_nav2_py with ROS 2 on Ubuntu's numpy; the wheels are for Python 3.12 on Linux.

    If `CSPACE_ROS_PREFIX` or /opt/ros/jazzy is a ROS 2 with Nav2, the page "On a Nav2 robot" is followed there.
    """
    try:
        session.install(ROS_NUMPY, *(f"ros-jazzy-{name}" for name in ROS_PACKAGES))
    except nox.command.CommandFailed:
        session.skip("the wheels ros-jazzy-* cannot be installed")
    tools = ("pytest", "pytest-xdist", "hypothesis", "python-fcl", "colcon-common-extensions")
    pins = Path("constraints.txt").read_text(encoding="utf-8").splitlines()
    file = Path(session.create_tmp(), "constraints.txt")
    kept = [pin for pin in pins if not pin.startswith(NEED_NUMPY_2)]
    file.write_text("\n".join(kept), encoding="utf-8")
    session.install("-c", str(file), "-e", ".", *tools, ROS_NUMPY)
    options = ("-q", "-n0", "--noconftest", "-W", "ignore::DeprecationWarning", *session.posargs)
    # rclpy starts once in a process. The gate's watch is compiled over the messages of the wheels; the
    # session "cpp" runs its dear tests.
    nodes = [
        f"ros/test_{name}"
        for name in ("planner_node", "nav2_handlers", "nav2_costmap", "nav2_page", "colcon")
    ]
    for number, name in enumerate((*nodes, "cpp/nav2/test_watch"), os.getpid()):
        # Runs beside this one have other domains, and so does each file: killed nodes are seen for seconds.
        domain = {
            "ROS_DOMAIN_ID": str(1 + number % 100),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        chosen = ("-m", "not thorough") if name.startswith("cpp") else ()
        session.run("python", "-m", "pytest", *options, *chosen, f"tests/{name}.py", env=domain)


@nox.session
def formats(session: nox.Session) -> None:
    """Run the scripts of "Bring your file", and hints, with the packages that they name, a gigabyte."""
    session.install("-c", "constraints.txt", "-e", ".[formats]")
    files = "tests/docs/bring_your_file.py", "tests/docs/foreign_values.py"
    session.run("python", "-m", "pytest", "-q", "-n0", *files)


@nox.session(venv_backend="none")
def growth(session: nox.Session) -> None:
    """Count the work on inputs of n, 4 n and 16 n, with kernels run as Python."""
    session.run(PYTHON, "-m", "pytest", "-q", "tests/growth", *session.posargs)


@nox.session(venv_backend="none")
def mutants(session: nox.Session) -> None:
    """Put faults into copies of the packages, and see that tests find them, e.g. `nox -s mutants -- raster`."""
    session.run(PYTHON, "-m", "tests.mutants", *session.posargs)


@nox.session(venv_backend="none")
def coverage(session: nox.Session) -> None:
    """Print the lines of Python that no test runs; compiled functions count as not run."""
    packages = (
        "-p",
        "pytest_cov.plugin",
        "--cov=cspace",
        "--cov=planners",
        "--cov-report=term-missing:skip-covered",
    )
    session.run(PYTHON, "-m", "pytest", "-q", "-m", "", *packages, *session.posargs)
