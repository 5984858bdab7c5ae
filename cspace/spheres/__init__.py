"""Spherical decomposition: balls that fill a shape from inside, or that cover it."""

from cspace.spheres.decomposition import decompose as decompose
from cspace.spheres.result import Bounds as Bounds
from cspace.spheres.result import Spheres as Spheres
