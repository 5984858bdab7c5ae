"""The engine: correlations of bitmaps by FFT, with integer results that are proven right."""

from cspace.fourier.correlation import Correlation as Correlation
from cspace.fourier.correlation import correlate as correlate
from cspace.fourier.correlation import least_seconds as least_seconds
from cspace.fourier.correlation import transform_bytes as transform_bytes
from cspace.fourier.correlation import transform_seconds as transform_seconds
