"""The frequency domain: descriptors, spectra, sets of balls, and their overlaps."""

from cspace.spectral._bump import Bump
from cspace.spectral._decompose import BallDecomposition, Bounds, decompose
from cspace.spectral._descriptors import (
    BallDescriptor,
    Descriptor,
    PolygonSum,
    indicator,
    intersection,
    minkowski_sum,
    superlevel,
    union,
)
from cspace.spectral._field import OverlapField
from cspace.spectral._overlap import FourierOverlap, Separation, Verdict
from cspace.spectral._placements import BallPenetration, Placements, best_placements
from cspace.spectral._spectra import ball_spectrum

__all__ = [
    "BallDecomposition",
    "BallDescriptor",
    "BallPenetration",
    "Bounds",
    "Bump",
    "Descriptor",
    "FourierOverlap",
    "OverlapField",
    "Placements",
    "PolygonSum",
    "Separation",
    "Verdict",
    "ball_spectrum",
    "best_placements",
    "decompose",
    "indicator",
    "intersection",
    "minkowski_sum",
    "superlevel",
    "union",
]
