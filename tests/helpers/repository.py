"""The folder of the repository and the source files of its packages."""

from importlib.util import find_spec
from pathlib import Path

PACKAGE_FOLDERS = [
    Path(str(spec.origin)).parent for name in ("cspace", "planners") if (spec := find_spec(name))
]
ROOT = PACKAGE_FOLDERS[0].parent


def name_module(file):
    """Return the name of the module in a file."""
    return ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


SOURCES = {
    name_module(file): file for folder in PACKAGE_FOLDERS for file in sorted(folder.rglob("*.py"))
}
"""File of each module of both packages."""
