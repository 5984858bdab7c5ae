"""Reasons: why two configurations are joined or not, and what would change that (experimental)."""

from cspace.reasons._explain import Explanation
from cspace.reasons._removals import Removals
from cspace.reasons._windows import Trial

__all__ = ["Explanation", "Removals", "Trial"]
