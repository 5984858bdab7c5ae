"""The frequency domain: descriptors and their spectra, balls that fill or cover shapes, and overlaps of ball sets."""

from cspace.spectral.bump import Bump as Bump
from cspace.spectral.decompose import BallDecomposition as BallDecomposition
from cspace.spectral.decompose import Bounds as Bounds
from cspace.spectral.decompose import decompose as decompose
from cspace.spectral.descriptors import BallDescriptor as BallDescriptor
from cspace.spectral.descriptors import Descriptor as Descriptor
from cspace.spectral.descriptors import PolygonSum as PolygonSum
from cspace.spectral.descriptors import indicator as indicator
from cspace.spectral.descriptors import intersection as intersection
from cspace.spectral.descriptors import minkowski_sum as minkowski_sum
from cspace.spectral.descriptors import superlevel as superlevel
from cspace.spectral.descriptors import union as union
from cspace.spectral.overlap import FourierOverlap as FourierOverlap
from cspace.spectral.overlap import OverlapField as OverlapField
from cspace.spectral.overlap import Separation as Separation
from cspace.spectral.overlap import Verdict as Verdict
from cspace.spectral.placements import BallPenetration as BallPenetration
from cspace.spectral.placements import Placements as Placements
from cspace.spectral.placements import best_placements as best_placements
from cspace.spectral.spectra import ball_spectrum as ball_spectrum

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
