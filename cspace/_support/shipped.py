"""Compiled code that comes with the package, for one processor and one version of each tool.

Wheels for x86-64 have it. Code that does not fit is not used, and functions are compiled.
"""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from typing import Final

import llvmlite
import numba
import numpy as np
from numba.core.registry import cpu_target

FOLDER: Final = Path(__file__).parents[1] / "_compiled"
"""Folder of the code, in a folder with the name that :func:`name_code` gave it."""

TARGET: Final = (
    "x86-64-v3",
    "+avx,+avx2,+bmi,+bmi2,+cmov,+cx16,+cx8,+f16c,+fma,+fxsr,+lzcnt,+mmx,+movbe,+popcnt,"
    "+sahf,+sse,+sse2,+sse3,+sse4.1,+sse4.2,+ssse3,+xsave",
)
"""Processor and its features for which the code is compiled, as LLVM names them."""


@cache
def name_code() -> str:
    """Return the name of folders of compiled code, from the versions on which all of it depends."""
    versions = f"numba-{numba.__version__}-llvmlite-{llvmlite.__version__}-numpy-{np.__version__}"
    return f"{versions}-{sys.implementation.cache_tag}"


@cache
def find_code_misfit() -> str:
    """Return why code that comes with the package is not used; "" if it is used."""
    names = [folder.name for folder in FOLDER.glob("*")]
    if not names:
        return "none came with the package"
    if name_code() not in names:
        return f"it is for {', '.join(names)}; this is {name_code()}"
    _, _, features = cpu_target.target_context.codegen().magic_tuple()
    missing = set(TARGET[1].split(",")) - set(features.split(","))
    return f"the processor lacks {', '.join(sorted(missing))}" if missing else ""
