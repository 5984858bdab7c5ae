"""Drives as values: their checks, texts and copies, and the twists that a gate refuses for them."""

import copy
import math
import pickle

import numpy as np
import pytest

import cspace
from cspace import InputError
from cspace._queries.vehicles import Car, Differential
from tests.helpers.gates import certify_twists
from tests.helpers.handmade import build_empty

DRIVES = (
    Differential(),
    Differential(reverse=True, max_lateral_acceleration=0.5),
    Car(turning_radius=2),
    Car(turning_radius=0.5, reverse=True),
    Car(turning_radius=0.5, reverse=True, reverse_cost=2.0, switch_cost=1),
    Differential(reverse=True, reverse_cost=3),
)
START = (2.0, 2.0, 0.0)


@pytest.fixture(scope="module")
def room():
    return build_empty((40, 40), cspace.Robot.rectangle(0.4, 0.2), rotations=8)


@pytest.mark.parametrize("drive", DRIVES, ids=repr)
def test_a_drive_equals_what_its_text_and_its_copies_make(drive):
    assert eval(repr(drive), {"Car": Car, "Differential": Differential}) == drive
    assert pickle.loads(pickle.dumps(drive)) == copy.deepcopy(drive) == drive
    assert hash(copy.copy(drive)) == hash(drive)
    assert [other == drive for other in DRIVES].count(True) == 1


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: Car(turning_radius=0.0), "turning_radius is 0.0; it must be one number"),
        (lambda: Car(turning_radius=math.inf), "turning_radius is inf"),
        (lambda: Car(turning_radius=math.nan), "turning_radius is nan"),
        (lambda: Car(turning_radius=(1.0, 2.0)), "it must be one number above zero"),
        (lambda: Car(turning_radius=1.0, reverse=1), "reverse is 1; it must be True or"),
        (lambda: Differential(reverse="no"), "reverse is 'no'; it must be True or False"),
        (lambda: Car(1.0, reverse=True, reverse_cost=0.5), "reverse_cost is 0.5; a metre in"),
        (lambda: Differential(reverse=True, reverse_cost=21), "costs as much as 1 to 20 ahead"),
        (lambda: Differential(reverse_cost=2.0), "reverse_cost is 2, and reverse is False"),
        (lambda: Car(1.0, reverse=True, switch_cost=-1.0), "switch_cost is -1.0; it must be one"),
        (lambda: Car(1.0, switch_cost=1.0), "switch_cost is 1, and reverse is False"),
        (
            lambda: Differential(max_lateral_acceleration=0),
            "max_lateral_acceleration is 0",
        ),
    ],
)
def test_wrong_fields_are_refused_when_a_drive_is_made(make, message):
    with pytest.raises(InputError) as caught:
        make()
    assert message in str(caught.value)


def test_numpys_numbers_become_plain_fields():
    assert Car(0.5) == Car(turning_radius=0.5)
    drive = Car(turning_radius=np.float32(0.5), reverse=np.True_)
    assert repr(drive) == "Car(turning_radius=0.5, reverse=True)"


@pytest.mark.parametrize("drive", ["dubins", Car, 0.5, {"turning_radius": 0.5}], ids=repr)
def test_what_is_no_drive_is_refused_by_gates(room, drive):
    for call in (
        lambda: cspace.Gate(room, drive=drive),
        lambda: certify_twists(room, START, [(0.1, 0.1)], 0.1, drive=drive),
    ):
        with pytest.raises(InputError) as caught:
            call()
        assert str(caught.value).startswith(f"drive is {drive!r}; it must be a planners.Car(...)")


@pytest.mark.parametrize(
    "drive, twist, names, text",
    [
        (Car(turning_radius=0.5), (-0.1, 0.0), ("v",), "v reverses at 0.1"),
        (Differential(), (-0.1, 0.0), ("v",), "v reverses at 0.1"),
        (Car(turning_radius=0.5), (0.1, 0.3), ("omega",), "omega is 0.3"),
        (
            Differential(max_lateral_acceleration=0.1),
            (0.5, -0.4),
            ("omega",),
            "omega accelerates sideways by 0.2",
        ),
    ],
)
def test_a_gate_refuses_twists_that_a_drive_cannot_follow(room, drive, twist, names, text):
    gate = cspace.Gate(room, dt=0.1, drive=drive)
    passed = gate.check_twists(START, [(0.1, 0.01), twist, (0.0, 0.0)])
    refusal = passed.chunk.refusal
    assert (passed.state, refusal.row, refusal.cause) == ("shortened", 1, "limit")
    assert refusal.names == names and text in refusal.message
    assert cspace.Gate(room, dt=0.1).check_twists(START, [(0.1, 0.01), twist]).state == "go"


@pytest.mark.parametrize(
    "drive, twists",
    [
        (Car(turning_radius=0.5, reverse=True), [(-0.1, 0.2), (0.1, -0.2), (0.0, 0.0)]),
        (Differential(reverse=True), [(-0.1, 2.0), (0.0, 3.0)]),
        (Differential(max_lateral_acceleration=0.1), [(0.0, 3.0), (0.5, 0.2)]),
    ],
)
def test_a_gate_passes_twists_that_a_drive_can_follow(room, drive, twists):
    assert cspace.Gate(room, dt=0.1, drive=drive).check_twists(START, twists).state == "go"
