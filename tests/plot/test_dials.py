"""Dials: the state of each rotation at one position."""

import numpy as np
from scipy.spatial.transform import Rotation

from cspace import CSpace, Robot, Rotations, Workspace, build
from cspace.plot import plot
from tests.pictures import COLORS, class_of, labels, pixel, rendered

POINT = (1.75, 2.0, 1.1)


def build_room(rotations: int | Rotations) -> CSpace:
    occupied = np.zeros((20, 20, 12), bool)
    occupied[10] = True
    occupied[10, 8:12, 3:8] = False
    return build(Workspace.from_array(occupied, 0.2), Robot.box((1.0, 0.3, 0.2)), rotations=rotations)


def color_at(space: CSpace, *rotation: float) -> tuple[int, ...]:
    q = (*POINT, *rotation)
    return COLORS[class_of(space, {int(space.classify(q))}, False)]


def test_a_ring_shows_the_state_of_each_yaw() -> None:
    space = build_room(36)
    ax = plot(space, view="rotations", center=POINT)
    image = rendered(ax)
    for yaw in np.radians(np.arange(-178.0, 180.0, 10.0)):
        assert pixel(ax, image, 0.8 * np.cos(yaw), 0.8 * np.sin(yaw)) == color_at(space, yaw)
    assert {"undecided (MIXED)", "free"} <= set(labels(ax))
    assert "(1.75, 2, 1.1) m" in ax.figure.get_suptitle()


def test_discs_show_the_state_of_each_heading_and_tilt() -> None:
    space = build_room(Rotations.quaternions(6))
    first = plot(space, view="rotations", center=POINT)
    image, discs = rendered(first), first.figure.axes
    assert [ax.get_title() for ax in discs] == [f"heading {k}°" for k in range(0, 360, 60)]
    rng, right = np.random.default_rng(2), 0
    for k, ax in enumerate(discs):
        radius, way = rng.uniform((0.05, -np.pi), (0.95, np.pi), (40, 2)).T
        x, y = radius * np.cos(way), radius * np.sin(way)
        tilts = Rotation.from_rotvec(np.pi * np.stack([-y, x, np.zeros(40)], axis=-1))
        turns = tilts * Rotation.from_rotvec([0.0, 0.0, k * np.pi / 3.0 + 1e-6])
        for position, turn in zip(zip(x, y, strict=True), turns.as_quat(), strict=True):
            right += pixel(ax, image, *position) == color_at(space, *turn)
    assert right >= 220  # the others are on the border of two cells or below text
