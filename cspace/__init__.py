"""Certified configuration-space maps for motion planning.

The public names are listed in ``__init__.pyi``. Each is imported at its first use, so that
importing the package costs next to nothing.
"""

from cspace._support import attach_stub, refuse_other_planners

refuse_other_planners()

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)

__version__ = "1.0.0rc1"
