"""SourceModule files on which compiled code depends."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Final

OWN_PACKAGES: Final = ("cspace", "planners")
"""Packages whose compiled code depends on the sources of both."""

KERNEL_MARKS: Final = (
    *("\n@kernel", "\n@internal", "\n@inlined", "\n@allocating"),
    *("\nimport numba", "\nfrom numba"),
)
"""Texts of which each file with kernels, or with options of the compiler, has one."""

_IMPORT: Final = re.compile(r"^from (\S+) import (?:\(([^)]*)\)|(.+))", re.MULTILINE)
_IMPORTED_NAME: Final = re.compile(r"(\w+)(?: as \w+)?")


class SourceModule:
    """A module's file and text, with its stub's.

    A stub lists the names that a package imports at their first use.
    """

    def __init__(self, file: Path, package: str = "") -> None:
        """Read a file of a package."""
        files = file, file.with_suffix(".pyi")
        self.file = file
        self.package = package
        self.text = "".join(each.read_text(encoding="utf-8") for each in files if each.exists())

    @cached_property
    def imports(self) -> dict[str, str]:
        """Module from which each name is imported."""
        found = dict[str, str]()
        for module, *names in _IMPORT.findall(self.text):
            home = f"{self.package}{module}".rstrip(".") if module.startswith(".") else module
            found |= dict.fromkeys(_IMPORTED_NAME.findall("".join(names)), home)
        return found

    def may_compile(self, name: str) -> bool:
        """Return False for a name of a function, or of a class that is no record."""
        if f"\nclass {name}(NamedTuple" in self.text:
            return True
        starts = (f"\ndef {name}(", f"\nclass {name}(", f"\nclass {name}:")
        return not any(start in self.text for start in starts)


def list_sources(users: Sequence[Path] = ()) -> list[Path]:
    """List the files on which compiled code depends, that of users included.

    These are the files with kernels, and files from which one of all these imports a constant or a
    record. A function is compiled with its own file, and other classes are not compiled.
    """
    sources = _read_own()
    found = {
        module
        for module, source in sources.items()
        if any(mark in source.text for mark in KERNEL_MARKS)
    }
    pending = [SourceModule(file) for file in users] + [sources[module] for module in found]
    found.add("cspace")  # the version
    while pending:
        for name, module in pending.pop().imports.items():
            home = _find_home(sources, module, name)
            if home and home not in found and sources[home].may_compile(name):
                found.add(home)
                pending.append(sources[home])
    return [*users, *sorted(sources[module].file for module in found)]


def digest_sources(users: Sequence[Path] = ()) -> str:
    """Return a digest of the texts of :func:`list_sources`."""
    digest = hashlib.sha256()
    for file in list_sources(users):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]  # 64 bits distinguish all versions on a machine


@cache
def _read_own() -> Mapping[str, SourceModule]:
    """Read the modules of both packages."""
    root = Path(__file__).parents[2]
    sources = {}
    for package in OWN_PACKAGES:
        for file in sorted((root / package).rglob("*.py")):
            folder = ".".join(file.parent.relative_to(root).parts)
            module = folder if file.stem == "__init__" else f"{folder}.{file.stem}"
            sources[module] = SourceModule(file, folder)
    return sources


def _find_home(sources: Mapping[str, SourceModule], module: str, name: str) -> str:
    """Return the module of ours that defines a name; "" for a module of others."""
    while module in sources:
        if f"{module}.{name}" in sources:
            return f"{module}.{name}"
        passed_on = sources[module].imports.get(name, module)
        if passed_on == module:
            return module
        module = passed_on
    return ""
