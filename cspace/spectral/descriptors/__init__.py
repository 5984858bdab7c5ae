"""Descriptors: functions that are above zero in a shape, their algebra and their spectra (Lysenko, 2013)."""

from cspace.spectral.descriptors.algebra import intersection as intersection
from cspace.spectral.descriptors.algebra import minkowski_sum as minkowski_sum
from cspace.spectral.descriptors.algebra import superlevel as superlevel
from cspace.spectral.descriptors.algebra import union as union
from cspace.spectral.descriptors.ball_spectra import ball_spectrum as ball_spectrum
from cspace.spectral.descriptors.ball_spectra import ball_spectrum_at as ball_spectrum_at
from cspace.spectral.descriptors.balls import BallDescriptor as BallDescriptor
from cspace.spectral.descriptors.bump import Bump as Bump
from cspace.spectral.descriptors.descriptor import Descriptor as Descriptor
from cspace.spectral.descriptors.descriptor import indicator as indicator
from cspace.spectral.descriptors.sampled_spectra import sampled_spectrum as sampled_spectrum
from cspace.spectral.descriptors.sampled_spectra import sampled_spectrum_at as sampled_spectrum_at
