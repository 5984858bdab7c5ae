"""Records that kernels read by their address."""

import pickle
from typing import NamedTuple

import numpy as np

from cspace._support.records import keep
from cspace.inside import internal, kernel


class Inner(NamedTuple):
    """Array of any order, and numbers."""

    rows: np.ndarray
    first: int
    is_marked: bool


class Outer(NamedTuple):
    """Record with a record, a tuple and an array between numbers."""

    scale: float
    inner: Inner
    offset: tuple
    flags: np.ndarray


@internal
def read_inner(inner, k):
    return inner.rows[inner.first + k, 1] + (100.0 if inner.is_marked else 0.0)


@kernel
def read_all(record, out):
    for k in range(len(out)):
        out[k] = record.scale * read_inner(record.inner, k) + record.offset[1]
        record.flags[k] = not record.flags[k]


def make_record(order="C", is_marked=True):
    rows = np.asarray(np.arange(8.0).reshape(4, 2), order=order)
    return Outer(0.5, Inner(rows, 1, is_marked), (7.0, 0.25), np.array([True, False]))


def test_kernels_read_and_write_the_arrays_and_numbers_of_kept_records():
    for order in "CF":
        for is_marked in (False, True):
            record = make_record(order, is_marked)
            out = np.empty(2)
            read_all(keep(record), out)
            added = 100.0 if is_marked else 0.0
            assert out.tolist() == [0.5 * (row + added) + 0.25 for row in (3.0, 5.0)]
            assert record.flags.tolist() == [False, True]  # entries are shared


def test_records_of_a_kind_have_one_type_whether_their_parts_are_kept():
    record = make_record()
    kept = keep(record)
    parts_kept = keep(record._replace(inner=keep(record.inner)))
    assert kept._numba_type_ is parts_kept._numba_type_
    assert keep(kept) is kept
    assert kept._numba_type_ != keep(make_record("F"))._numba_type_
    assert kept.inner.first == 1 and kept._replace(scale=2.0).scale == 2.0


def test_kept_records_are_pickled_with_their_arrays():
    out, again = np.empty(2), np.empty(2)
    kept = keep(make_record())
    copy = pickle.loads(pickle.dumps(kept))
    assert copy.address != kept.address
    read_all(kept, out)
    read_all(copy, again)
    assert out.tolist() == again.tolist()
