"""Folders of the C++ headers, for compilers and CMake."""

from __future__ import annotations

from pathlib import Path

_PACKAGE = Path(__file__).parents[1]


def get_include() -> str:
    """Return the folder to add to a compiler's include path, for ``<cspace/map.hpp>``."""
    return str(_PACKAGE / "include")


def get_cmake_dir() -> str:
    """Return the folder of ``cspaceConfig.cmake``, for ``cspace_DIR`` of CMake."""
    return str(_PACKAGE / "cmake")
