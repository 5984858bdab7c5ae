"""Read a map drawn in a text file, a character a cell.

Dots and blanks are free, and all else is a wall, also what a short line lacks. A separator after
each cell, such as a blank or a comma, is no cell.
"""

from pathlib import Path

import numpy as np

import cspace
from cspace.errors import FileError


def read_text_map(path: str, spacing: float = 0.1, free: str = ". ") -> cspace.Workspace:
    """Read a drawing whose first line is at the top; ``free`` lists the free characters."""
    lines = Path(path).read_text(encoding="utf-8-sig").splitlines()
    separators = {character for line in lines for character in line[1::2]}
    if len(separators) == 1 and separators <= set(" ,;\t"):
        lines = [line[::2] for line in lines]
    found = set("".join(lines))
    if not found & set(free) or "\t" in found:
        problem = f"has the characters {''.join(sorted(found))!r:.60}"
        rule = f"{free!r} are free, and tabs are no cells"
        raise FileError(path, problem, rule, "pass free='0', or what is free")
    width = max(map(len, lines))
    cells = np.array([list(line.ljust(width, "#")) for line in lines])
    return cspace.Workspace.from_array(~np.isin(cells, list(free))[::-1].T, spacing)


if __name__ == "__main__":
    import sys

    print(read_text_map(sys.argv[1]))
