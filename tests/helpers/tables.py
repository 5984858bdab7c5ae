"""Tables and rows of other packages, and of none, with named columns."""

import sqlite3
from importlib.util import find_spec

import numpy as np
import pandas as pd


class Table:
    """Columns that convert to rows by place, and are found by name."""

    def __init__(self, columns, /, **names):
        self._columns = columns
        self.__dict__.update(names)

    def __getitem__(self, name):
        return self._columns[name]

    def __array__(self, dtype=None, copy=None):
        return np.stack(list(self._columns.values()), axis=-1)


def make_row(columns):
    """Return the first row of columns as a database does."""
    connection = sqlite3.connect(":memory:")
    connection.row_factory = sqlite3.Row
    names = ", ".join(f'? as "{name}"' for name in columns)
    return connection.execute(
        f"select {names}", [float(each[0]) for each in columns.values()]
    ).fetchone()


def iterate_tables(columns):
    """Yield the kind and the table of each package that is here, and of others by stand-ins."""
    names = list(columns)
    numbers = np.stack(list(columns.values()), axis=-1)
    yield "pandas", pd.DataFrame(columns)
    yield "pandas, by rows", pd.DataFrame(numbers.T, index=names)
    yield "structured", np.rec.fromarrays(list(columns.values()), names=names)
    yield "columns", Table(columns, columns=names)
    yield "column_names", Table(columns, column_names=names, columns=list(columns.values()))
    yield "keys", Table(columns, keys=lambda: names)
    if find_spec("pyarrow"):
        import pyarrow

        yield "pyarrow", pyarrow.table(columns)
        yield "record batch", pyarrow.record_batch(columns)
    if find_spec("polars"):
        import polars

        yield "polars", polars.DataFrame(columns)
    if find_spec("astropy"):
        from astropy.table import Table as AstropyTable

        yield "astropy", AstropyTable(columns)
        yield "rows of astropy", list(AstropyTable(columns))
