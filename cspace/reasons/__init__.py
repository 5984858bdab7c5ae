"""Reasons: why two configurations are joined or not, and what would change that (experimental).

Words that the modules of this package share:

- *way*: the widest chain of cells from start to goal; *barrier*: the cells that close it.
- *window*: a box of cells that a finer map decides.
- *region*: connected cells that the same named obstacles make not FREE.
"""

from cspace.reasons._explain import Explanation
from cspace.reasons._removals import Removals
from cspace.reasons._windows import Trial

__all__ = ["Explanation", "Removals", "Trial"]
