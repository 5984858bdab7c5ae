"""Spaces that users define."""

import numpy as np

import cspace


class OpenSpace(cspace.Space):
    """The unit square, without obstacles."""

    axes = ("x", "y")
    bounds = ((0.0, 0.0), (1.0, 1.0))

    def is_free(self, q):
        return True

    def motion_is_free(self, q0, q1):
        return True


class Disc(cspace.Space):
    """A point that avoids a disc around the origin, in the plane or with a yaw."""

    bounds = ((-2.0, -2.0), (2.0, 2.0))

    def __init__(self, *axes):
        self._axes = axes

    @property
    def axes(self):
        return self._axes

    def is_free(self, q):
        return self.motion_is_free(q, q)

    def motion_is_free(self, q0, q1):
        first = np.asarray(q0)[:2]
        last = np.asarray(q1)[:2]
        step = last - first
        t = np.clip(-first @ step / max(step @ step, 1e-12), 0.0, 1.0)
        return bool(np.hypot(*(first + t * step)) > 1.0)
