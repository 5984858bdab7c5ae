"""Names of planners for packages beside them, which may change with each version.

They are listed in ``inside.pyi``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("planners", __file__)
