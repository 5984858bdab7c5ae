"""Foundations of all packages: arrays, checks, compiling, heaps, threads and vectors."""

import lazy_loader  # type: ignore[import-untyped]

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["heap", "vectors"])
