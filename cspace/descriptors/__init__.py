"""Descriptors: functions that are above zero in a shape, their algebra and their spectra (Lysenko, 2013)."""

from cspace.descriptors.algebra import intersection as intersection
from cspace.descriptors.algebra import minkowski_sum as minkowski_sum
from cspace.descriptors.algebra import superlevel as superlevel
from cspace.descriptors.algebra import union as union
from cspace.descriptors.ball_spectra import ball_spectrum as ball_spectrum
from cspace.descriptors.ball_spectra import ball_spectrum_at as ball_spectrum_at
from cspace.descriptors.balls import BallDescriptor as BallDescriptor
from cspace.descriptors.bump import Bump as Bump
from cspace.descriptors.descriptor import Descriptor as Descriptor
from cspace.descriptors.descriptor import indicator as indicator
from cspace.descriptors.sampled_spectra import sampled_spectrum as sampled_spectrum
from cspace.descriptors.sampled_spectra import sampled_spectrum_at as sampled_spectrum_at
