"""The inner door: names of the core for people who write packages beside it.

Packages outside the core import public names and these, and nothing else of it. The names are
listed in ``inside.pyi``, and the page "Extending" says what each does. They may change from one
version to the next.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub("cspace", __file__)
