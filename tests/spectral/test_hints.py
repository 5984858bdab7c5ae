"""Hints of the frequency domain: each is followed by code."""

import math

import numpy as np
import pytest
import shapely

from cspace import Robot, Rotations
from cspace.spectral import (
    BallPenetration,
    Bump,
    ContactTest,
    EarlyTest,
    FourierOverlap,
    Verdict,
    ball_spectrum,
    best_placements,
    decompose,
)
from tests.helpers.refusals import check_refused, refusals

pytest.importorskip("finufft")

SQUARE = Robot.rectangle(0.4, 0.4)
SLIVER = Robot.polygon([(0, 0), (1, 1e-9), (2, 0)])
LINE = shapely.LineString([(0, 0), (1, 0)])
PAIR = ([(0.0, 0.0)], [0.1])
SMALL = [[0.0, 0.0]], 1e-120
IN_SPACE = ([(0.0, 0.0, 0.0)], [0.1])
FAR = ([(1e9, 0.0)], [0.1])


def overlap(a=PAIR, b=PAIR, **options):
    """Make the overlap of two sets of balls."""
    return FourierOverlap(a, b, **options)


def spectrum(lengths=1.0, counts=8, **options):
    """Transform one ball."""
    return ball_spectrum(*PAIR, Bump(), lengths=lengths, counts=counts, **options)


@refusals(
    "call, hint",
    (lambda: Bump(-1.0), "it must be one number from 0.01 to 10000, or infinite"),
    (lambda: overlap(bump=2.0), "it must be a Bump"),
    (
        lambda: decompose(SQUARE),
        "number is None and tolerance is None; exactly one of them chooses the balls",
    ),
    (
        lambda: decompose(SQUARE, number=0),
        "it must be a whole number above zero",
    ),
    (
        lambda: decompose(LINE, kind="inner", number=4),
        "shape has no inside; inner balls need one",
    ),
    (
        lambda: decompose(shapely.Point(1, 2), kind="outer", number=4),
        "shape is 0 m across; balls by number need a finite size",
    ),
    (
        lambda: decompose(Robot.disc(0.1), number=4),
        "shape consists of balls already; decompose() finds balls for other shapes",
    ),
    (
        lambda: overlap(([(0, 0), (1, 0)], [0.1, 0.0])),
        "each must be above zero",
    ),
    (
        lambda: overlap(PAIR, IN_SPACE),
        "b has 3 dimensions, its counterpart has 2; they must agree",
    ),
    (
        lambda: overlap(SQUARE),
        "a is a Robot; it must have centers and radii, or be a pair of them",
    ),
    (
        lambda: bool(Verdict.MISS),
        "a verdict is neither true nor false",
    ),
    (lambda: overlap(FAR), "rounding would matter"),
    (
        lambda: ContactTest(decompose(SQUARE, kind="inner", number=4), PAIR),
        "outer_a is of kind 'inner'; it must be 'outer'",
    ),
    (
        lambda: ContactTest(PAIR, PAIR, inner_a=PAIR),
        "inner_a or inner_b is missing; a HIT needs both",
    ),
    (
        lambda: overlap().moved([3], (0.0, 0.0)),
        "chosen is [3]; it must be indices of the 1 balls of b, or a mask of them",
    ),
    (
        lambda: overlap().moved([0], (1.0, 0.0)),
        "step is (1.0, 0.0), which moves balls out of the bounding box of b; periods are as long as that box needs",
    ),
    (
        lambda: best_placements(PAIR, PAIR, 4, n=0),
        "it must be a whole number above zero",
    ),
    (lambda: spectrum(0.1), "they must fit into one period"),
    (lambda: spectrum((1, 1, 1)), "it must be one number above zero or 2 of them, in metres"),
    (
        lambda: spectrum(counts=2.5),
        "it must be one whole number above zero or 2 of them, and at most 67108864 frequencies in all",
    ),
    (
        lambda: spectrum(counts=2**20),
        "it must be one whole number above zero or 2 of them, and at most 67108864 frequencies in all",
    ),
    (
        lambda: decompose(SLIVER, kind="inner", number=1),
        "inner balls need an inside",
    ),
    (
        lambda: BallPenetration([0.1], PAIR).value_and_gradient([(0, 0), (1, 1)]),
        "the last axes must be 1 balls and 2 coordinates",
    ),
    (
        lambda: spectrum(tolerance=1.0),
        "it must be one number from 1e-12 to 0.1",
    ),
    (
        lambda: EarlyTest(PAIR, 0.0),
        "overlap is a tuple; it must be a FourierOverlap",
    ),
    (
        lambda: EarlyTest(overlap(), -1.0),
        "it must be one number above zero, in square or cubic metres",
    ),
    (lambda: Bump().radial_spectrum(2e5, 2), "it must be at most 100000"),
    (lambda: decompose(SQUARE, tolerance=1e-7), "its proof needs too many cells below "),
    (lambda: decompose([], number=3), "no geometry"),
    (lambda: overlap(SMALL, SMALL), "rounding would matter"),
    (lambda: overlap().rotated(np.diag([1.0, -1.0])), "rotation matrix"),
    (lambda: overlap(IN_SPACE, IN_SPACE).rotated(0.5), "Rotation"),
    (lambda: overlap().moved([0], (0.0, 0.0, 0.0)), "step"),
    (lambda: overlap().moved([0], (math.nan, 0.0)), "step"),
    (lambda: best_placements(PAIR, PAIR, Rotations.quaternions(2)), "in the plane turns"),
    (lambda: spectrum(counts=10**9), "frequencies in all"),
    (
        lambda: ball_spectrum([(0.0, 0.0), (0.0, 0.9)], 0.1, Bump(), lengths=1.0, counts=4),
        "along y",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, hint):
    check_refused(call, hint)
