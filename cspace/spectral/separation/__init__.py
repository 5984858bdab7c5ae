"""Overlap of ball sets in the frequency domain, and proofs from a few frequencies that they are apart or collide."""

from cspace.spectral.separation.field import OverlapField as OverlapField
from cspace.spectral.separation.fourier_overlap import FourierOverlap as FourierOverlap
from cspace.spectral.separation.verdict import Separation as Separation
from cspace.spectral.separation.verdict import Verdict as Verdict
