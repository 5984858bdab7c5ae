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
from tests.helpers.refusals import check_followed, refusals

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
    "call, advised, hint",
    (lambda: Bump(-1.0), lambda: [Bump(2.0), Bump(math.inf)], "pass e.g. 2.0, or math.inf"),
    (lambda: overlap(bump=2.0), lambda: overlap(bump=Bump(2.0)), "pass e.g. Bump(2.0)"),
    (
        lambda: decompose(SQUARE),
        lambda: [decompose(SQUARE, number=64), decompose(SQUARE, tolerance=0.01)],
        "number is None and tolerance is None; exactly one of them chooses the balls; pass e.g. number=64, or tolerance=0.01 in metres",
    ),
    (lambda: decompose(SQUARE, number=0), lambda: decompose(SQUARE, number=64), "pass e.g. 64"),
    (
        lambda: decompose(LINE, kind="inner", number=4),
        lambda: [
            decompose(LINE, kind="outer", tolerance=0.1),
            decompose(SQUARE, kind="inner", number=4),
        ],
        "shape has no inside; inner balls need one; pass kind='outer', or a shape with an area or volume",
    ),
    (
        lambda: decompose(shapely.Point(1, 2), kind="outer", number=4),
        lambda: decompose(shapely.Point(1, 2), kind="outer", tolerance=0.1),
        "shape is 0 m across; balls by number need a finite size; pass a tolerance instead",
    ),
    (
        lambda: decompose(Robot.disc(0.1), number=4),
        lambda: overlap((b := Robot.disc(0.1).shape) and (b.centers, b.radii)),
        "shape consists of balls already; decompose() finds balls for other shapes; use these balls",
    ),
    (
        lambda: overlap(([(0, 0), (1, 0)], [0.1, 0.0])),
        lambda: overlap(([(0, 0)], [0.1])),
        "drop balls that have no volume",
    ),
    (
        lambda: overlap(PAIR, IN_SPACE),
        lambda: [overlap(PAIR, PAIR), overlap(IN_SPACE, IN_SPACE)],
        "b has 3 dimensions, its counterpart has 2; they must agree; pass all in the plane or all in space",
    ),
    (
        lambda: overlap(SQUARE),
        lambda: overlap(decompose(SQUARE, number=8)),
        "a is a Robot; it must have centers and radii, or be a pair of them; decompose other shapes first",
    ),
    (
        lambda: bool(Verdict.MISS),
        lambda: Verdict.MISS == Verdict.MISS,
        "compare it, e.g. verdict == Verdict.MISS",
    ),
    (lambda: overlap(FAR), lambda: overlap(PAIR), "move the origin nearer, or check the units"),
    (
        lambda: ContactTest(decompose(SQUARE, kind="inner", number=4), PAIR),
        lambda: ContactTest(decompose(SQUARE, kind="outer", number=4), PAIR),
        "outer_a is of kind 'inner'; it must be 'outer'; decompose the shape with that kind",
    ),
    (
        lambda: ContactTest(PAIR, PAIR, inner_a=PAIR),
        lambda: [
            ContactTest(PAIR, PAIR),
            ContactTest(PAIR, PAIR, inner_a=PAIR, inner_b=PAIR),
        ],
        "inner_a or inner_b is missing; a HIT needs both; pass both or neither",
    ),
    (
        lambda: overlap().moved([3], (0.0, 0.0)),
        lambda: overlap().moved([0], (0.0, 0.0)),
        "chosen is [3]; it must be indices of the 1 balls of b, or a mask of them; pass e.g. [0]",
    ),
    (
        lambda: overlap().moved([0], (1.0, 0.0)),
        lambda: overlap(PAIR, ([(1.0, 0.0)], [0.1])),
        "step is (1.0, 0.0), which moves balls out of the bounding box of b; periods are as long as that box needs; pass the moved balls to a new FourierOverlap",
    ),
    (
        lambda: best_placements(PAIR, PAIR, 4, n=0),
        lambda: best_placements(PAIR, PAIR, 4, n=10),
        "pass e.g. 10",
    ),
    (lambda: spectrum(0.1), lambda: spectrum(1.0), "pass a longer period"),
    (lambda: spectrum((1, 1, 1)), lambda: spectrum((1, 1)), "pass the period along each axis"),
    (lambda: spectrum(counts=2.5), lambda: spectrum(counts=256), "pass e.g. 256"),
    (lambda: spectrum(counts=2**20), lambda: spectrum(counts=256), "pass e.g. 256"),
    (
        lambda: decompose(SLIVER, kind="inner", number=1),
        lambda: [
            decompose(SLIVER, kind="outer", number=1),
            decompose(SQUARE, kind="inner", number=4),
        ],
        "pass kind='outer', or a thicker shape",
    ),
    (
        lambda: BallPenetration([0.1], PAIR).value_and_gradient([(0, 0), (1, 1)]),
        lambda: BallPenetration([0.1], PAIR).value_and_gradient([(0, 0)]),
        "pass all balls",
    ),
    (
        lambda: spectrum(tolerance=1.0),
        lambda: spectrum(tolerance=1e-9),
        "pass e.g. 1e-9",
    ),
    (
        lambda: EarlyTest(PAIR, 0.0),
        lambda: EarlyTest(overlap(), 0.001),
        "overlap is a tuple; it must be a FourierOverlap; pass FourierOverlap(a, b)",
    ),
    (
        lambda: EarlyTest(overlap(), -1.0),
        lambda: EarlyTest(overlap(), 0.001),
        "pass it in square or cubic metres",
    ),
    (lambda: Bump().radial_spectrum(2e5, 2), "units"),
    (lambda: decompose(SQUARE, tolerance=1e-7), "pass at least about"),
    (lambda: decompose([], number=3), "no geometry"),
    (lambda: overlap(SMALL, SMALL), "check the units"),
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
def test_the_frequency_domain_as_the_hint_says_is_accepted(call, advised, hint):
    check_followed(call, advised, hint)
