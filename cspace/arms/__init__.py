"""Arms: robots with joints, whose configurations and motions are proven free (experimental).

Four rooms, each with its words, support :class:`Arm` and :class:`ArmSpace`: readers of files,
proofs about bodies, searches of paths, and maps of joints.
"""

from cspace.inside import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
