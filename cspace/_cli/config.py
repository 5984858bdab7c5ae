"""Command that prints the folders of the C++ headers."""

from __future__ import annotations

from typing import Annotated

import typer

from cspace.errors import InputError


def config(
    include: Annotated[
        bool, typer.Option("--include", help="Print the folder of the C++ headers.")
    ] = False,
    cmake_dir: Annotated[
        bool, typer.Option("--cmake-dir", help="Print the folder for cspace_DIR of CMake.")
    ] = False,
) -> None:
    """Print where the C++ headers and their CMake package are.

    For example: cmake -S . -B build -Dcspace_DIR=$(cspace config --cmake-dir)
    """
    from cspace._support.headers import get_cmake_dir, get_include

    if include == cmake_dir:
        rule = "one of --include and --cmake-dir must be given"
        raise InputError("config", "names no folder", rule, "pass --cmake-dir for CMake")
    typer.echo(get_include() if include else get_cmake_dir())
