"""The frequency domain: descriptors and their spectra, balls that fill or cover shapes, and overlaps of ball sets."""

from cspace.spectral.bump import Bump
from cspace.spectral.decompose import decompose
from cspace.spectral.descriptors import (
    BallDescriptor,
    Descriptor,
    indicator,
    intersection,
    minkowski_sum,
    superlevel,
    union,
)
from cspace.spectral.field import OverlapField
from cspace.spectral.overlap import FourierOverlap, Separation, Verdict
from cspace.spectral.spectra import ball_spectrum
from cspace.spectral.spheres import Bounds, Spheres

__all__ = [
    "BallDescriptor",
    "Bounds",
    "Bump",
    "Descriptor",
    "FourierOverlap",
    "OverlapField",
    "Separation",
    "Spheres",
    "Verdict",
    "ball_spectrum",
    "decompose",
    "indicator",
    "intersection",
    "minkowski_sum",
    "superlevel",
    "union",
]
