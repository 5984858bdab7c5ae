"""Hints of the frequency domain: each is followed by code."""

import math

import numpy as np
import pytest
import shapely

from cspace import Grid, Robot, Rotations, Workspace, build
from cspace.spectral import (
    BallDescriptor,
    Bump,
    Descriptor,
    FourierOverlap,
    OverlapField,
    Verdict,
    ball_spectrum,
    best_placements,
    decompose,
    indicator,
    minkowski_sum,
    superlevel,
    union,
)
from tests.helpers.refusals import check_followed, refusals

pytest.importorskip("finufft")

GRID = Grid((0, 0), 0.1, (8, 8))
FINE = Grid((0, 0), 0.05, (8, 8))
SQUARE = Robot.rectangle(0.4, 0.4)
LINE = shapely.LineString([(0, 0), (1, 0)])
THIN = shapely.box(0, 0, 1, 1e-6)
PAIR = ([(0.0, 0.0)], [0.1])
IN_SPACE = ([(0.0, 0.0, 0.0)], [0.1])
FAR = ([(1e9, 0.0)], [0.1])
SPACE = build(Workspace.from_array(np.eye(9, dtype=bool), 0.1), Robot.disc(0.1))
FLAT = Robot.capsule(0.1, 0.2).shape
DESCRIPTOR = indicator(SQUARE, GRID)
ROUND = shapely.Point(0, 0).buffer(1.0, quad_segs=800)


def overlap(a=PAIR, b=PAIR, **options):
    """Make the overlap of two sets of balls."""
    return FourierOverlap(a, b, **options)


def balls(pair=PAIR, alpha=2.0):
    """Make a descriptor of balls."""
    return BallDescriptor(*pair, Bump(alpha))


def spectrum(lengths=1.0, counts=8, **options):
    """Transform one ball."""
    return ball_spectrum(*PAIR, Bump(), lengths=lengths, counts=counts, **options)


@refusals(
    "call, advised, hint",
    (lambda: Bump(-1.0), lambda: [Bump(2.0), Bump(math.inf)], "pass e.g. 2.0, or math.inf"),
    (lambda: Bump().profile(-0.5), lambda: Bump().profile(abs(-0.5)), "pass the modulus"),
    (lambda: overlap(bump=2.0), lambda: overlap(bump=Bump(2.0)), "pass e.g. Bump(2.0)"),
    (
        lambda: Bump().table(2, 3.0, tolerance=1.0),
        lambda: Bump().table(2, 3.0, tolerance=1e-9),
        "pass e.g. 1e-9",
    ),
    (
        lambda: Bump().table(2, 3.0)(np.array([9.0])),
        lambda: Bump().table(2, 9.0)(np.array([9.0])),
        "make a larger table",
    ),
    (
        lambda: decompose(SQUARE),
        lambda: [decompose(SQUARE, number=64), decompose(SQUARE, tolerance=0.01)],
        "pass e.g. number=64, or tolerance=0.01 in metres",
    ),
    (lambda: decompose(SQUARE, number=0), lambda: decompose(SQUARE, number=64), "pass e.g. 64"),
    (
        lambda: decompose(LINE, kind="inner", number=4),
        lambda: [
            decompose(LINE, kind="outer", tolerance=0.1),
            decompose(SQUARE, kind="inner", number=4),
        ],
        "pass kind='outer', or a shape with an area or volume",
    ),
    (
        lambda: decompose(THIN, kind="inner", number=4),
        lambda: decompose(SQUARE, kind="inner", number=4),
        "pass kind='outer', or a thicker shape",
    ),
    (
        lambda: decompose(Robot.disc(0.1), number=4),
        lambda: overlap((b := Robot.disc(0.1).shape) and (b.centers, b.radii)),
        "use these balls",
    ),
    (
        lambda: minkowski_sum(ROUND, ROUND),
        lambda: minkowski_sum(*(shapely.simplify(ROUND, 0.1),) * 2),
        "simplify both, e.g. with shapely.simplify",
    ),
    (
        lambda: Descriptor(GRID, np.zeros((2, 2))),
        lambda: Descriptor(GRID, np.zeros((8, 8))),
        "pass one value for each cell",
    ),
    (
        lambda: overlap(([(0, 0), (1, 0)], [0.1, 0.0])),
        lambda: overlap(([(0, 0)], [0.1])),
        "drop balls that have no volume",
    ),
    (
        lambda: overlap(PAIR, IN_SPACE),
        lambda: [overlap(PAIR, PAIR), overlap(IN_SPACE, IN_SPACE)],
        "pass all in the plane or all in space",
    ),
    (
        lambda: overlap(SQUARE),
        lambda: overlap(decompose(SQUARE, number=8)),
        "decompose other shapes first",
    ),
    (
        lambda: overlap(balls(), balls(alpha=1.0)),
        lambda: overlap(balls(), balls(alpha=1.0), bump=Bump(2.0)),
        "pass bump=",
    ),
    (
        lambda: indicator(FLAT, Grid((0, 0, 0), 0.1, (4, 4, 4))),
        lambda: [
            indicator(shape, Grid((0, 0, 0), 0.1, (4, 4, 4))) for shape in (FLAT.outer, FLAT.inner)
        ],
        "pass shape.outer or shape.inner",
    ),
    (
        lambda: superlevel(balls()),
        lambda: [superlevel(balls().sample(GRID)), superlevel(indicator(SQUARE, GRID))],
        "make one with sample(grid) or indicator(shape, grid)",
    ),
    (
        lambda: union(balls(), balls(alpha=1.0)),
        lambda: union(balls().sample(GRID), balls(alpha=1.0).sample(GRID)),
        "sample them on one grid first",
    ),
    (lambda: superlevel(DESCRIPTOR, [0]), lambda: superlevel(DESCRIPTOR, 0.0), "pass e.g. 0.0"),
    (
        lambda: minkowski_sum(DESCRIPTOR, indicator(SQUARE, FINE)),
        lambda: minkowski_sum(DESCRIPTOR, indicator(SQUARE, GRID)),
        "sample both on similar grids",
    ),
    (
        lambda: union(DESCRIPTOR, indicator(SQUARE, FINE)),
        lambda: union(DESCRIPTOR, indicator(SQUARE, GRID)),
        "sample all on it",
    ),
    (
        lambda: OverlapField(SPACE, np.zeros(3)),
        lambda: OverlapField.of(SPACE, overlap()),
        "use OverlapField.of",
    ),
    (
        lambda: OverlapField.of(SPACE, PAIR),
        lambda: OverlapField.of(SPACE, FourierOverlap.of_shapes(PAIR, PAIR)),
        "make it with e.g. FourierOverlap.of_shapes",
    ),
    (
        lambda: bool(Verdict.MISS),
        lambda: Verdict.MISS == Verdict.MISS,
        "compare it, e.g. verdict == Verdict.MISS",
    ),
    (
        lambda: overlap(threshold=-1.0),
        lambda: overlap(threshold=0.0),
        "pass square or cubic metres",
    ),
    (lambda: overlap(FAR), lambda: overlap(PAIR), "move the origin nearer, or check the units"),
    (
        lambda: FourierOverlap.of_shapes(decompose(SQUARE, kind="inner", number=4), PAIR),
        lambda: FourierOverlap.of_shapes(decompose(SQUARE, kind="outer", number=4), PAIR),
        "decompose the shape with that kind",
    ),
    (
        lambda: FourierOverlap.of_shapes(PAIR, PAIR, inner_a=PAIR),
        lambda: [
            FourierOverlap.of_shapes(PAIR, PAIR),
            FourierOverlap.of_shapes(PAIR, PAIR, inner_a=PAIR, inner_b=PAIR),
        ],
        "pass both or neither",
    ),
    (
        lambda: FourierOverlap.of_shapes(PAIR, PAIR, classes=0),
        lambda: FourierOverlap.of_shapes(PAIR, PAIR, classes=8),
        "pass e.g. 8",
    ),
    (lambda: overlap(band=1e9), lambda: overlap(band=10.0), "pass a lower one"),
    (
        lambda: best_placements(PAIR, PAIR, 4, n=0),
        lambda: best_placements(PAIR, PAIR, 4, n=10),
        "pass e.g. 10",
    ),
    (
        lambda: best_placements(PAIR, PAIR, rotations=[]),
        lambda: best_placements(PAIR, PAIR, rotations=Rotations.of(36)),
        "pass e.g. Rotations.of(36)",
    ),
    (lambda: spectrum(weights=[1, 2]), lambda: spectrum(weights=[1]), "pass numbers"),
    (lambda: spectrum(0.1), lambda: spectrum(1.0), "pass a longer period"),
    (lambda: spectrum((1, 1, 1)), lambda: spectrum((1, 1)), "pass the period along each axis"),
    (lambda: spectrum(counts=2.5), lambda: spectrum(counts=256), "pass e.g. 256"),
    (lambda: spectrum(counts=2**20), lambda: spectrum(counts=2**8), "pass smaller counts"),
)
def test_the_frequency_domain_as_the_hint_says_is_accepted(call, advised, hint):
    check_followed(call, advised, hint)
