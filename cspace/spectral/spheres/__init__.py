"""Spherical decomposition: balls that fill a shape from inside, or that cover it."""

from cspace.spectral.spheres.decomposition import decompose as decompose
from cspace.spectral.spheres.result import Bounds as Bounds
from cspace.spectral.spheres.result import Spheres as Spheres
