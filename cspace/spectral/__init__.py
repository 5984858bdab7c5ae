"""Balls that fill or cover shapes, their proofs and overlaps (experimental).

Words that the modules of this package share:

- *bump*: the radial function that stands for a ball, and is zero outside it.
- *overlap*: the integral of the product of two sums of bumps.
- *spectrum*: the Fourier transform of a sum of bumps; *band*: the frequencies that are kept.
- *inner* balls lie in a shape, *outer* balls cover it.
- *growth*: the length by which an inner ball must grow to contain its part of the shape.
"""

from cspace.spectral._ball_sets import BallsLike as BallsLike
from cspace.spectral._ball_sets import as_balls as as_balls  # for cspace.arms
from cspace.spectral._bump import Bump
from cspace.spectral._decompose import BallDecomposition, Bounds, decompose
from cspace.spectral._early import EarlyTest
from cspace.spectral._overlap import FourierOverlap
from cspace.spectral._placements import BallPenetration, Placements, best_placements
from cspace.spectral._spectra import ball_spectrum
from cspace.spectral._trees import ContactTest, Verdict

__all__ = [
    "BallDecomposition",
    "BallPenetration",
    "Bounds",
    "Bump",
    "ContactTest",
    "EarlyTest",
    "FourierOverlap",
    "Placements",
    "Verdict",
    "ball_spectrum",
    "best_placements",
    "decompose",
]
