"""Maps for other software: files, labelled arrays and messages, a module each (experimental)."""

from cspace.inside import attach_stub

__getattr__, __dir__, _ = attach_stub(__name__, __file__)

__all__: list[str] = []
