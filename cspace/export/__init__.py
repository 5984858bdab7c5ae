"""Maps for other software: files, labelled arrays and messages, a module each (experimental)."""

import lazy_loader

__getattr__, __dir__, _ = lazy_loader.attach_stub(__name__, __file__)

__all__: list[str] = []
