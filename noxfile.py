"""The project's tasks: ``nox --list`` shows them, and ``nox -s lint`` runs one.

Each Python has its own environment for the tests. All other tasks run in the environment that nox is installed in.
"""

import sys

import nox

PYTHON = sys.executable
"""The Python that nox runs with, and whose environment the tasks without one of their own use."""

nox.options.sessions = ["lint", "test"]
nox.options.reuse_venv = "yes"


@nox.session(python=["3.11", "3.12", "3.13"])
def test(session: nox.Session) -> None:
    """Run the tests on each Python, e.g. `nox -s test-3.12 -- tests/rotations`."""
    session.install("-e", ".[test]")
    session.run("python", "-m", "pytest", "-q", *session.posargs)


@nox.session(venv_backend="none")
def lint(session: nox.Session) -> None:
    """Check style, format, spelling and types."""
    session.run(PYTHON, "-m", "ruff", "check")
    session.run(PYTHON, "-m", "ruff", "format", "--check")
    session.run(PYTHON, "-m", "codespell_lib")
    session.run(PYTHON, "-m", "mypy")


@nox.session(venv_backend="none")
def docs(session: nox.Session) -> None:
    """Build the documentation, and run its tutorials and examples."""
    session.run(PYTHON, "-m", "sphinx", "-W", "--keep-going", "docs", "docs/_build", *session.posargs)


@nox.session(venv_backend="none")
def bench(session: nox.Session) -> None:
    """Run benchmarks by name, e.g. `nox -s bench -- edges callbacks`; without a name, all of them, in small sizes."""
    session.run(PYTHON, "-m", "benchmarks", *(session.posargs or ["all", "--quick"]))


@nox.session(venv_backend="none")
def soak(session: nox.Session) -> None:
    """Compare new random cases with exact geometry, e.g. `nox -s soak -- --quick maps`."""
    session.run(PYTHON, "-m", "tests.soak", *session.posargs)
