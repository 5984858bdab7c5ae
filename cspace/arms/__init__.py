"""Arms: robots with joints, whose configurations and motions are proven free (experimental).

:meth:`Arm.from_urdf` reads an arm, :func:`build_arm_space` sets it among obstacles, and
:func:`planners.plan` plans in the space. :func:`build_joint_map` maps some of its joints.
"""

# Four rooms, each with its words, support Arm and ArmSpace: readers of files, proofs about bodies,
# searches of paths, and maps of joints.

from cspace.inside import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
