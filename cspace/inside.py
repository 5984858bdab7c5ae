"""The inner door: names of the core for people who write packages beside it.

Packages outside the core import public names and these, and nothing else of it. The names are
listed in ``inside.pyi``, and the page "Extending" says what each does. They may change from one
version to the next.
"""

from cspace._support import attach_stub

__getattr__, __dir__, __all__ = attach_stub("cspace", __file__)
