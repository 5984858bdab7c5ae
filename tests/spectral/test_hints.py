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
    (lambda: Bump(-1.0), "alpha is -1.0 ... 0.01 to 10000,"),
    (lambda: overlap(bump=2.0), "bump is 2.0 ... Bump"),
    (
        lambda: decompose(SQUARE),
        "number is None and tolerance is None ... chooses",
    ),
    (
        lambda: decompose(SQUARE, number=0),
        "number is 0 ... whole number above zero",
    ),
    (
        lambda: decompose(LINE, kind="inner", number=4),
        "shape has no inside ... inner",
    ),
    (
        lambda: decompose(shapely.Point(1, 2), kind="outer", number=4),
        "shape is 0 m across ... size",
    ),
    (
        lambda: decompose(Robot.disc(0.1), number=4),
        "shape consists of balls already ... decompose()",
    ),
    (
        lambda: overlap(([(0, 0), (1, 0)], [0.1, 0.0])),
        "a has a radius of 0 ... above zero",
    ),
    (
        lambda: overlap(PAIR, IN_SPACE),
        "b has 3 dimensions, its counterpart has 2 ... agree",
    ),
    (
        lambda: overlap(SQUARE),
        "a is a Robot ... radii",
    ),
    (
        lambda: bool(Verdict.MISS),
        "verdict is MISS ... neither",
    ),
    (lambda: overlap(FAR), "b or a reaches 1e+09 m from its origin, over a period of ... matter"),
    (
        lambda: ContactTest(decompose(SQUARE, kind="inner", number=4), PAIR),
        "outer_a is of kind 'inner' ... 'outer'",
    ),
    (
        lambda: ContactTest(PAIR, PAIR, inner_a=PAIR),
        "inner_a or inner_b is missing ... needs",
    ),
    (
        lambda: overlap().moved([3], (0.0, 0.0)),
        "chosen is [3] ... indices",
    ),
    (
        lambda: overlap().moved([0], (1.0, 0.0)),
        "step is (1.0, 0.0), which moves balls out of the bounding ... periods",
    ),
    (
        lambda: best_placements(PAIR, PAIR, 4, n=0),
        "n is 0 ... whole number above zero",
    ),
    (
        lambda: spectrum(0.1),
        "lengths holds 0.1 m along x, but the balls extend over 0.2 m ... fit into one period",
    ),
    (lambda: spectrum((1, 1, 1)), "lengths is (1, 1, 1) ... zero"),
    (
        lambda: spectrum(counts=2.5),
        "counts is 2.5 ... 67108864",
    ),
    (
        lambda: spectrum(counts=2**20),
        "counts is 1048576 ... 67108864",
    ),
    (
        lambda: decompose(SLIVER, kind="inner", number=1),
        "shape is too thin for any ball that was found ... inner",
    ),
    (
        lambda: BallPenetration([0.1], PAIR).value_and_gradient([(0, 0), (1, 1)]),
        "centers has shape (2, 2) ... coordinates",
    ),
    (
        lambda: spectrum(tolerance=1.0),
        "tolerance is 1.0 ... 1e-12 to 0.1",
    ),
    (
        lambda: EarlyTest(PAIR, 0.0),
        "overlap is a tuple ... FourierOverlap",
    ),
    (
        lambda: EarlyTest(overlap(), -1.0),
        "threshold is -1.0 ... square",
    ),
    (
        lambda: Bump().radial_spectrum(2e5, 2),
        "frequency holds 200000 cycles per radius ... at most 100000",
    ),
    (
        lambda: decompose(SQUARE, tolerance=1e-7),
        "tolerance is 1e-07 m, but the shape is 0.565685 m across ... proof",
    ),
    (lambda: decompose([], number=3), "no geometry"),
    (
        lambda: overlap(SMALL, SMALL),
        "b or a reaches 2e-120 m from its origin, over a period of ... matter",
    ),
    (lambda: overlap().rotated(np.diag([1.0, -1.0])), "rotation matrix"),
    (lambda: overlap(IN_SPACE, IN_SPACE).rotated(0.5), "Rotation"),
    (lambda: overlap().moved([0], (0.0, 0.0, 0.0)), "step"),
    (lambda: overlap().moved([0], (math.nan, 0.0)), "step"),
    (
        lambda: best_placements(PAIR, PAIR, Rotations.quaternions(2)),
        "rotations are 32 rotations in space ... turns",
    ),
    (lambda: spectrum(counts=10**9), "counts is 1000000000 ... frequencies"),
    (
        lambda: ball_spectrum([(0.0, 0.0), (0.0, 0.9)], 0.1, Bump(), lengths=1.0, counts=4),
        "along y",
    ),
)
def test_wrong_arguments_are_refused_in_one_line(call, hint):
    check_refused(call, hint)
