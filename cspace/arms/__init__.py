"""Arms: robots with joints, whose configurations and motions are proven free (experimental).

Four rooms hold what :class:`Arm` and :class:`ArmSpace` are built on, each with its words: readers
of files, proofs about bodies, searches of paths, and maps of joints.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
