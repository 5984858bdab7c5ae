"""Command that prints the folders of the C++ headers."""

from __future__ import annotations

import typer

from cspace._cli.options import flag
from cspace.errors import InputError


def config(
    include: bool = flag("--include", "Print the folder of the C++ headers."),
    cmake_dir: bool = flag("--cmake-dir", "Print the folder for cspace_DIR of CMake."),
) -> None:
    """Print the folders of C++ headers and CMake package.

    For example: cmake -S . -B build -Dcspace_DIR=$(cspace config --cmake-dir)
    """
    from cspace import get_cmake_dir, get_include

    if include == cmake_dir:
        rule = "one of --include and --cmake-dir must be given"
        raise InputError("config", "names no folder", rule)
    typer.echo(get_include() if include else get_cmake_dir())
