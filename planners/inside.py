"""Names of planners for packages beside them, which may change with each version.

They are listed in ``inside.pyi``.
"""

from cspace.inside import attach_stub

__getattr__, __dir__, __all__ = attach_stub("planners", __file__)
