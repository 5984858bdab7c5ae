"""Reasons: why two configurations are joined or not, and what would change that."""

from cspace.reasons.explain import Explanation
from cspace.reasons.removals import Removals

__all__ = ["Explanation", "Removals"]
