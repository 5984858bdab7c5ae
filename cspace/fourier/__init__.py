"""The engine: correlations of bitmaps by FFT, with integer results that are proven right."""

from cspace.fourier.correlate import Correlation as Correlation
from cspace.fourier.correlate import correlate as correlate
