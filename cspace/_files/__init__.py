"""Readers of files into arrays, one format per module, without grids or maps."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
