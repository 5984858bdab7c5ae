"""Foundations of all packages: arrays, checks, compiling, heaps, threads and vectors."""

from __future__ import annotations

import os
import sys
from _thread import RLock

import lazy_loader  # type: ignore[import-untyped]

TYPE_CHECKING = False  # of typing, whose import would take a fifth of the time of cspace's
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any, Final

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["heap", "vectors"])

_TURN: Final = RLock()


def attach_stub(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package with a stub of its names."""
    try:
        import_name, list_names, names = lazy_loader.attach_stub(package, file)
    except ValueError as error:
        raise ImportError(f"{file} is in an archive; cspace runs only from a folder") from error

    def find_name(name: str) -> Any:
        """Import a public name; raise AttributeError, with our word for it, for any other one."""
        if name in names or name.startswith("_"):
            return import_in_turn(import_name, name)
        from cspace._support.check import make_name_error

        raise make_name_error(sys.modules[package], package, name, names)

    return find_name, list_names, names


def refuse_other_planners() -> None:
    """Raise ImportError if another distribution named ``planners`` is installed."""
    for folder in filter(os.path.isdir, sys.path):
        # Importing pathlib would take longer than importing cspace.
        for name in os.listdir(folder):  # noqa: PTH208
            if name.startswith("planners-") and name.endswith(".dist-info"):
                raise ImportError(
                    f"{folder} has another package named planners, which replaces files of "
                    "cspace; use an environment without it, and install cspace again"
                )


def import_in_turn(import_name: Callable[[str], Any], name: str) -> Any:
    """Import a name while no other thread does.

    Threads that import a package and one of its modules at once would stop each other. A thread
    that runs the body of a module does not wait, because it has locked that module.
    """
    if _is_importing():
        return import_name(name)
    with _TURN:
        return import_name(name)


def _is_importing() -> bool:
    """Return True if this thread runs the body of a module that is being imported."""
    frame = sys._getframe()
    while frame.f_back is not None:
        frame = frame.f_back
        spec = frame.f_globals.get("__spec__")
        if frame.f_code.co_name == "<module>" and getattr(spec, "_initializing", False):
            return True
    return False
