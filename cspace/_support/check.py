"""Validators of arguments: each returns the checked value, or raises InputError."""

from __future__ import annotations

import difflib
import inspect
import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import lru_cache, wraps
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._support.arrays import AXES, Bools, Floats, Ints, frozen
from cspace._support.column_names import are_names, list_columns, list_dimensions, takes_names
from cspace._support.kinds import make_kind_error, suggest_call
from cspace._support.reporting import warn_user
from cspace._support.units import check_unit, warn_of_large
from cspace.errors import AngleWarning, InputError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")

MAX_NUMBER: Final = 1e100
"""Largest length, position or other number that is taken; its squares and cubes are finite."""

MAX_COUNT: Final = 2**53
"""Largest count. Floats represent all whole numbers up to it exactly."""

_NUMERIC: Final = "it must be numeric"
"""Rule of messages about values that are no numbers."""

_NO_ROWS: Final = (str, bytes, Mapping, np.number, np.bool_)
"""Types with entries that are no rows of numbers."""

_SIZE: Final = re.compile(
    r"^(?!(stroke|marker|font|icon|text|label)_)(.*_)?"
    r"((r|size|width|buffer|scale|extent|inflation|clearance|margin|padding)(_|\d|$)|units$|"
    r"\w*(radius|radii|diameter|thickness))"
    r"|^(offset|shift|translation)s?$"
)
"""Name, in lower case, that gives a point or a line a size, its unit or another place.

Names of drawings are none.
"""

_WORD_BREAK: Final = re.compile(r"(?<=[a-z\d])(?=[A-Z])|\W+")
"""Place between two words of a name."""


def check_real(values: ArrayLike, name: str, axes: Sequence[str] = ()) -> NDArray[Any]:
    """Return values as an array of real numbers.

    Integers and booleans keep their type; other types become float64. ``axes`` name the entries of
    the last axis, in order. Raises InputError if a value is not a real number, or is too large for
    float64, or if labels are not the axes.
    """
    kind: type[Any] = type(values)
    if kind is tuple or kind is list:
        values = order_labels(values, name, axes)
    elif kind is not float and (kind is not np.ndarray or values.dtype.names):  # type: ignore[union-attr]
        check_unmasked(values, name)
        check_unit(values, name)
        values = order_labels(values, name, axes)
    # Refuse None and texts, because numpy would turn None into NaN and parse texts as numbers.
    # Arrays of objects, such as fractions, are converted if they hold numbers.
    try:
        array = np.asarray(values)
        if values is None or array.dtype.kind in "USMm":
            raise TypeError("texts, dates and None are no numbers")
        if array.dtype.kind == "O" and any(isinstance(each, str | bytes) for each in array.flat):
            raise TypeError("a text is no number")
        if array.dtype.kind not in "fiubc":
            array = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, RuntimeError) as error:  # the last one of sparse arrays
        raise make_kind_error(values, name, _NUMERIC) from error
    except OverflowError as error:
        problem = "has too large an integer"
        raise InputError(name, problem, "it must fit a float") from error
    if array.dtype.kind == "c":
        raise InputError(name, "has complex values", "it must be real")
    return array


def order_labels(values: Any, name: str, axes: Sequence[str]) -> Any:
    """Return values in the order of axes, if their columns have names.

    Names are columns of a table, the index of a Series, labels of a dimension of xarray, and fields
    of named tuples and of structured arrays. Raises InputError if they are not the axes.
    """
    if type(values) is tuple or isinstance(values, list):
        return _order_rows(values, name, axes)
    for dimension in getattr(values, "dims", ()) if hasattr(values, "sel") else ():
        labels = values.coords[dimension].values if dimension in values.coords else ()
        if are_names(labels):
            _check_labels(labels, name, axes)
            return values.sel({dimension: list(axes)}).transpose(..., dimension).values
    columns = list_columns(values)
    if columns:
        _check_labels(columns, name, axes)
        return take_columns(values, name, axes)
    index = getattr(values, "index", ())
    if not callable(index) and set(map(str, index)) & set(axes):
        return order_labels(values.T, name, axes)  # of a table whose rows are the axes
    if axes and takes_names(values, axes[0]):
        raise make_kind_error(values, name, "a table must list the names of its columns")
    return values


def take_columns(values: Any, name: str, axes: Sequence[str]) -> Any:
    """Return columns of a table, shape (n, len(axes)), or entries of a row, by name.

    Raises InputError if a column has masked entries, another unit, or no numbers.
    """
    is_row = isinstance(values, tuple)  # with named entries
    try:
        columns = [getattr(values, axis) if is_row else values[axis] for axis in axes]
        arrays = [np.asarray(column) for column in columns]
        ordered = columns if is_row else np.stack(arrays, axis=-1)
    except (TypeError, ValueError, LookupError, RuntimeError) as error:
        raise make_kind_error(values, name, "its columns must be found by name") from error
    for column in columns:
        check_unmasked(column, name)
        check_unit(column, name)
    return ordered


def _order_rows(values: Any, name: str, axes: Sequence[str]) -> Any:
    """Return a list of rows with each row in axes' order."""
    # Long lists hold few types, and numpy would drop the labels, units and masks of rows.
    kinds = set(map(type, values))
    if bool in kinds and len(kinds) > 1:  # numpy would turn them into numbers
        raise make_kind_error(values, name, _NUMERIC)
    if any(map(_may_have_labels, kinds)):
        return [check_real(row, f"{name}[{number}]", axes) for number, row in enumerate(values)]
    return values


def _may_have_labels(kind: type[Any]) -> bool:
    """Return True for a type of rows or numbers that may have labels, a unit or a mask."""
    is_plain = kind in (list, tuple, np.ndarray) or issubclass(kind, _NO_ROWS)
    return hasattr(kind, "__getitem__") and not is_plain


def _check_labels(labels: Iterable[Any], name: str, axes: Sequence[str]) -> None:
    """Raise InputError unless labels are the names of axes, in any order."""
    given = [str(label) for label in labels]
    if sorted(given) == sorted(axes):
        return
    problem = f"has the labels {', '.join(given)}"
    if not axes:
        raise InputError(name, problem, "they have no effect here")
    rule = f"they must be {', '.join(axes)}"
    wrong = next((label for label in given if label not in axes), "")
    raise InputError(name, problem, rule, suggest_name(wrong, axes))


def parse_finite(text: str, separator: str | None = None) -> list[float]:
    """Parse finite numbers between blanks or separators, or return an empty list."""
    try:
        numbers = [float(word) for word in text.split(separator)]
    except ValueError:
        return []
    return numbers if np.isfinite(numbers).all() else []


def check_finite(
    values: ArrayLike,
    name: str,
    axes: Sequence[str] = (),
    largest: float = float(np.finfo(np.float64).max),
) -> Floats:
    """Return values as a float64 array.

    ``axes`` are as for :func:`check_real`. Raises InputError as it does, and if a value is NaN,
    infinite or beyond the largest.
    """
    numbers = check_real(values, name, axes)
    if numbers.dtype.kind == "b":
        raise make_kind_error(values, name, _NUMERIC)
    array = np.asarray(numbers, dtype=np.float64)
    is_within = np.abs(array) <= largest
    if not is_within.all():
        entry, value = _first_wrong_entry(array, name, ~is_within)
        rule = "it must be finite"
        if np.isfinite(value):
            rule = f"it must be from {-largest:g} to {largest:g}"
        raise InputError(entry, f"is {value}", rule)
    return array


def _first_wrong_entry(array: NDArray[Any], name: str, wrong: Bools) -> tuple[str, Any]:
    """Return the name and the value of the first wrong entry.

    A name is, for example, ``points[2, 0]``.

    ``wrong`` is a mask with at least one entry set.
    """
    index = tuple(np.argwhere(wrong)[0].tolist())
    entry = f"{name}[{', '.join(map(str, index))}]" if index else name
    return entry, array[index].item()


def check_unmasked(values: Any, name: str) -> None:
    """Raise InputError for masked entries, because they are neither free nor occupied."""
    if not isinstance(values, np.ma.MaskedArray):
        return
    mask = np.ascontiguousarray(np.ma.getmaskarray(values))
    count = int(mask.view(np.bool_).sum())  # structured arrays have a mask for each field
    if count:
        problem = f"has {count} masked entries"
        raise InputError(name, problem, "each must have a value")


def check_number(value: Any, name: str) -> float:
    """Return a number of at most 1e100 as float, or raise InputError."""
    number = check_finite(value, name, largest=MAX_NUMBER)
    if number.ndim:
        raise InputError(name, f"is {value!r}", "it must be one number")
    return float(number)


def check_positive(value: Any, name: str, unit: str = "metres") -> float:
    """Return a positive number as a float; warn if it is larger than its unit suggests.

    Raises InputError if it is not one number, not finite, not above zero, or outside [1e-100,
    1e100].
    """
    # Squares and cubes of numbers in this range do not overflow or underflow float64.
    if type(value) is float and 1.0 / MAX_NUMBER < value < MAX_NUMBER:
        warn_of_large(value, unit, name)
        return value
    array = check_finite(value, name)
    problem = f"is {value!r}"
    if array.ndim or array <= 0.0:
        raise InputError(name, problem, f"it must be one number above zero, in {unit}")
    if not 1.0 / MAX_NUMBER < array < MAX_NUMBER:
        raise InputError(name, problem, f"it must be in [1e-100, 1e100] {unit}")
    warn_of_large(array, unit, name)
    return float(array)


def check_not_negative(value: Any, name: str, unit: str = "metres") -> float:
    """Return a number that is zero or above as a float; warn as :func:`check_positive`.

    Raises InputError if it is not one number, not finite, negative, or above 1e100.
    """
    array = check_finite(value, name, largest=MAX_NUMBER)
    if array.ndim or array < 0.0:
        rule = "it must be one number, zero or above" + (f", in {unit}" if unit else "")
        raise InputError(name, f"is {value!r}", rule)
    warn_of_large(array, unit, name)
    return float(array)


def check_count(value: Any, name: str, minimum: int = 0, maximum: int | None = None) -> int:
    """Return a whole number from ``minimum`` to ``maximum`` as an int.

    The default maximum is :data:`MAX_COUNT`.

    Raises InputError if the value is no such number.
    """
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    highest = MAX_COUNT if maximum is None else maximum
    if number is not None and minimum <= number <= highest:
        return number
    # Messages name the default maximum only if the number exceeds it.
    if maximum is not None or (number is not None and number > highest):
        span = f"from {minimum} to {highest}"
    elif minimum == 1:
        span = "above zero"
    else:
        span = f"from {minimum} on"
    raise InputError(name, f"is {value!r}", f"it must be a whole number {span}")


def check_word(value: Any, name: str, choices: Sequence[Any]) -> None:
    """Raise InputError unless a value is one of a few."""
    if isinstance(value, bool) or not isinstance(value, str | int) or value not in choices:
        *others, last = map(repr, choices)
        rule = f"it must be {', '.join(others)} or {last}"
        similar = suggest_name(value, [word for word in choices if isinstance(word, str)])
        raise InputError(name, f"is {value!r}", rule, similar)


def check_known(value: object, name: str, known: Collection[str], verb: str = "is") -> str:
    """Return a known name; raise InputError, with the most similar name, otherwise."""
    if isinstance(value, str) and value in known:
        return value
    raise InputError(name, f"{verb} {value!r}", _list_names(known), suggest_name(value, known))


def _list_names(known: Collection[str]) -> str:
    """Return the rule of messages that lists known names, or the first 20."""
    listed = list(known)[:20]
    if len(listed) < len(known):
        listed.append(f"and {len(known) - len(listed)} others")
    return f"there are {', '.join(listed)}" if known else "there is none"


OTHER_NAMES: Final[Mapping[str, str]] = {
    # Shapes.
    "circle": "disc",
    "rect": "rectangle",
    "sphere": "ball",
    # Files and arrays.
    "fromfile": "open",
    "frommesh": "from_mesh",
    "fromnumpy": "from_array",
    "frompolygon": "polygon",
    "fromimage": "open",
    "frommap": "open",
    "fromoctomap": "open",
    "load": "open",
    "read": "open",
    # Drives and planners.
    "ackermann": "Car",
    "dubins": "Car",
    "dubinscar": "Car",
    "reedsshepp": "Car",
    "diffdrive": "Differential",
    "unicycle": "Differential",
    "astar": "Grid",
    "dijkstra": "Grid",
    "hybridastar": "Lattice",
    "rrt": "Search",
    "rrtconnect": "Search",
    "rrtstar": "Search",
    "simplesetup": "simple_setup",
    # Plans.
    "plan": "planners.plan",
    "goalbias": "planner",
    "simplify": "planner",
    "timeout": "time_limit",
    "solved": "status",
}
"""Names that other packages and fields use, in lower-case letters, with ours."""


def suggest_name(value: object, known: Collection[str]) -> str:
    """Return "did you mean ...?" with our word for a name, or one that looks alike; or "".

    A name looks alike if it has at most two letters more or less.
    """
    word = str(value).lower().replace("*", "star")  # as in RRT*
    ours = OTHER_NAMES.get(re.sub(r"[\W_]", "", word))
    if ours in known:
        return f"did you mean {ours!r}?"
    # What ROS calls resolution is our spacing.
    names = {name.lower().replace("resolution", "spacing"): name for name in known}
    word = word.replace("resolution", "spacing")
    near = [name for name in names if abs(len(name) - len(word)) <= 2]
    # A letter too many costs a name of n letters a likeness of 1 / (2 n), and a wrong letter 1 / n.
    likeness = max(0.66, 1.0 - 1.1 / max(1, len(word)))
    similar = difflib.get_close_matches(word, near, 1, likeness)
    return f"did you mean {names[similar[0]]!r}?" if similar else ""


class _PublicNames:
    """An owner of names whose private ones Python does not suggest."""

    def __init__(self, owner: object) -> None:
        """Keep the owner."""
        self._owner = owner

    def __dir__(self) -> list[str]:
        """List the public names."""
        return [name for name in dir(self._owner) if not name.startswith("_")]


def make_name_error(owner: object, title: str, name: str, known: Collection[str]) -> AttributeError:
    """Make the error for a name that a package or a class lacks."""
    public = [each for each in known if not each.startswith("_")]
    hint = suggest_name(name, [*public, "planners.plan"]) or _list_names(public)
    text = f"{title} has no {name!r}; {hint}"
    return AttributeError(text, name=name, obj=_PublicNames(owner))


_BY_PLACE: Final = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
"""Kinds of parameters that values without names are given to."""


def _refuse_name(owner: object, name: str) -> Any:
    """Raise AttributeError for an unknown name of a class or an object, with our word for it."""
    kind = owner if isinstance(owner, type) else type(owner)
    # Packages probe values for names of theirs, and Python itself suggests names that look alike.
    if kind is not owner and name not in OTHER_NAMES:
        text = f"{kind.__name__} has no {name!r}"
        raise AttributeError(text, name=name, obj=_PublicNames(owner))
    raise make_name_error(owner, kind.__name__, name, dir(kind))


class AnswersNames(type):
    """A class that answers an unknown name of its own with the one that was meant."""

    if not TYPE_CHECKING:  # otherwise type checkers would take any name
        __getattr__ = _refuse_name


def names_options(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Make a function, or a class, check truth values, and explain a call that does not fit.

    It takes a tenth of a microsecond. Objects of the class answer unknown names as
    :class:`AnswersNames` does.
    """
    if isinstance(function, type):
        constructor = vars(function)["__init__"]
        setattr(function, "__init__", names_options(constructor))  # noqa: B010
        setattr(function, "__getattr__", _refuse_name)  # noqa: B010
        return function
    parameters = inspect.signature(function).parameters
    names = list(parameters)
    flags = [name for name in names if parameters[name].annotation == "bool"]
    by_place = [name for name in names if parameters[name].kind in _BY_PLACE]

    @wraps(function)
    def call(*values: Arguments.args, **options: Arguments.kwargs) -> Result:
        """Call the function, if truth values are True or False."""
        if flags:
            given = {**dict(zip(by_place, values, strict=False)), **options}
            for flag in flags:
                check_flag(given.get(flag, True), flag)
        try:
            return function(*values, **options)
        except TypeError:
            _check_call(function, values, options)
            raise

    return call


def _check_call(
    function: Callable[..., Any], values: Sequence[Any], options: Mapping[str, Any]
) -> None:
    """Raise TypeError, with the parameters, if a function cannot be called with these values."""
    signature = inspect.signature(function)
    try:
        signature.bind(*values, **options)
    except TypeError as error:
        problem = str(error)
    else:
        return
    parameters = list(signature.parameters.values())
    called = function.__qualname__
    if parameters[:1] and parameters[0].name in ("self", "cls"):
        owner, *values = values
        kind = owner if isinstance(owner, type) else type(owner)
        called = f"{kind.__name__}.{function.__name__}".removesuffix(".__init__")
        del parameters[0]
    names = [each.name for each in parameters]
    for name in options:
        if name not in names:
            left = sorted(names[len(values) :])
            hint = suggest_name(name, left) or f"its options are {', '.join(left)}"
            raise TypeError(f"{called}() has no option {name!r}; {hint}") from None
    by_place = [each.name for each in parameters if each.kind in _BY_PLACE]
    rule = f"it takes {', '.join(by_place)}" if by_place else f"its options are {', '.join(names)}"
    if 0 < len(by_place) < len(names):
        rule += ", and others by name"
    needed = [str(each.annotation) for each in parameters if each.default is each.empty]
    hint = _suggest_values(needed, values)
    raise TypeError("; ".join(filter(None, (f"{called}(): {problem}", rule, hint)))) from None


def _suggest_values(needed: Sequence[str], values: Sequence[Any]) -> str:
    """Return a hint to join numbers to the points that a call needs, or to pass them one by one.

    ``needed`` are the types of the parameters without a default.
    """
    parts: Sequence[Any] = ()
    if set(needed) == {"float"} and len(values) == 1 and np.shape(values[0]) == (len(needed),):
        parts = values[0]
    size, rest = divmod(len(values), max(1, len(needed)))
    are_numbers = all(isinstance(value, int | float) for value in values)
    if set(needed) == {"ArrayLike"} and are_numbers and size > 1 and not rest:
        parts = [tuple(values[k : k + size]) for k in range(0, len(values), size)]
    return f"pass {', '.join(map(repr, parts))}" if len(parts) else ""


def check_each(
    values: ArrayLike | Mapping[str, Any],
    name: str,
    names: Sequence[str],
    units: Sequence[str] = (),
    defaults: Mapping[str, float] = MappingProxyType({}),
) -> Floats:
    """Return one number for all ``names``, or one each, shape (k,).

    A mapping gives numbers by name, and may leave out those with a default. Raises InputError if a
    number is missing, negative or not finite, a name is unknown, or the shape differs. Warns if a
    number is larger than its unit or its default suggests.
    """
    rule = f"it must be one number, or one for each of {', '.join(names)}"
    if isinstance(values, Mapping):
        given = dict(defaults)
        for key, value in values.items():
            given[check_known(key, name, names, "names")] = value
        missing = [each for each in names if each not in given]
        if missing:
            raise InputError(name, f"lacks {', '.join(missing)}", rule)
        values = [given[each] for each in names]
    numbers = check_finite(values, name, names)
    if numbers.shape not in ((), (len(names),)):
        raise InputError(name, f"has shape {numbers.shape}", rule)
    if (numbers < 0.0).any():
        raise InputError(name, f"is {values!r}", "it must be zero or above")
    spread = np.broadcast_to(numbers, len(names))
    for unit in dict.fromkeys(units):
        warn_of_large(spread[np.array(units) == unit], unit, name)
    for each, number in zip(names, spread.tolist(), strict=True):
        # A number of degrees is 57 times that of radians.
        if number > 5.0 * defaults.get(each, math.inf):
            warn_user(
                f"{name} of {each} is {number:g}, {number / defaults[each]:.3g} times what it has",
                AngleWarning,
            )
    return numbers


def check_text(value: object, name: str) -> str:
    """Return a string; raise InputError if it is empty."""
    if not isinstance(value, str) or not value:
        rule = "it must be a non-empty string"
        raise InputError(name, f"is {value!r}", rule)
    return value


def choose_text(value: object, name: str, default: str) -> str:
    """Return a string, or a default for None or an empty one; raise InputError for another kind."""
    if value is not None and not isinstance(value, str):
        raise make_kind_error(value, name, "it must be a string")
    return value or default


def check_flag(value: object, name: str) -> None:
    """Raise InputError for a value that is neither True nor False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(name, f"is {value!r}", "it must be True or False")


def check_rng(rng: object) -> np.random.Generator:
    """Return `rng`, or a freshly seeded generator if it is None.

    Raises InputError if it is anything else.
    """
    if rng is None:
        return np.random.default_rng()
    if not isinstance(rng, np.random.Generator):
        rule = "it must be a numpy.random.Generator or None"
        raise InputError("rng", f"is {rng!r}", rule)
    return rng


def check_rows(values: ArrayLike, name: str, axes: Sequence[str]) -> NDArray[Any]:
    """Return real numbers of any type as an array, shape (..., len(axes)).

    They may be NaN or infinite. Raises InputError if a value is not a real number, the last axis
    has another length, or labels are not the axes.
    """
    array = check_real(values, name, axes)
    if array.dtype.kind == "b":
        raise make_kind_error(values, name, _NUMERIC)
    if array.ndim == 0 or array.shape[-1] != len(axes):
        rule = f"its last axis must be {len(axes)} long, for {', '.join(axes)}"
        raise InputError(name, f"has shape {array.shape}", rule)
    return array


def check_points(values: ArrayLike, name: str, axes: Sequence[str]) -> Floats:
    """Return finite points as float64, shape (..., len(axes)).

    Raises InputError as :func:`check_rows`, and if a value is not finite.
    """
    return check_finite(check_rows(values, name, axes), name)


@lru_cache  # features of a file repeat the names of their properties
def _gives_size(name: str) -> bool:
    """Return True if a name gives a point or a line a size."""
    return bool(_SIZE.search(_WORD_BREAK.sub("_", name).lower()))


def find_sizes(names: Iterable[str]) -> dict[str, str]:
    """Return the names, each by itself, that give points a size."""
    known = list(names)
    sizes = {name: name for name in known if _gives_size(name)}
    if {"r", "g", "b"} <= set(map(str.lower, known)):  # a colour
        sizes = {name: name for name in sizes if name.lower() != "r"}
    return sizes


def select_positions(values: Any, name: str) -> NDArray[Any]:
    """Return positions as an array of real numbers.

    Of a table or a structured array, the columns x, y (and z) are taken. Raises InputError as
    :func:`check_real`.
    """
    columns = list_columns(values)
    axes = [axis for axis in AXES if axis in columns]
    if {"x", "y"} <= set(axes):
        values = take_columns(values, name, axes)
    coordinates = values.coords if hasattr(values, "sel") else {}
    labels = {label for each in coordinates.values() for label in each.values.flat}
    return check_real(values, name, axes or [axis for axis in AXES if axis in labels] or AXES)


def check_point(value: ArrayLike, name: str = "center", dim: int = 2) -> Floats:
    """Return a copy of the coordinates of one point, shape (dim,).

    Raises InputError if the shape differs, or a value is not finite or beyond 1e100.
    """
    point = check_finite(value, name, AXES[:dim], MAX_NUMBER)
    if point.shape != (dim,):
        rule = f"it must be {dim} numbers in metres"
        raise InputError(name, f"has shape {point.shape}", rule)
    return point.copy()


def check_bounds(bounds: ArrayLike, dim: int = 2) -> Floats:
    """Return a map's corners, shape (2, dim).

    ``bounds`` has that shape, or is ``xmin, ymin, (zmin,) xmax, ymax(, zmax)``. Raises InputError
    if it has another shape, or an upper value is not above the lower value.
    """
    names = [f"{axis}{end}" for end in ("min", "max") for axis in "xyz"[:dim]]
    others = [f"{name[1:]}{name[0]}" for name in names]  # as geopandas writes them
    known = set(list_columns(bounds))
    axes = next((each for each in (names, others) if known.issuperset(each)), AXES[:dim])
    box = check_finite(bounds, "bounds", axes)
    if box.shape == (1, 2 * dim):
        box = box[0]
    if box.shape not in ((2 * dim,), (2, dim)):
        rule = f"it must be {', '.join(names)} in metres, or the lower and the upper corner"
        raise InputError("bounds", f"is {bounds!r}", rule)
    corners = box.reshape(2, dim)
    lower, upper = corners
    if (upper <= lower).any():
        rule = f"{', '.join(names[dim:])} must be above {', '.join(names[:dim])}"
        raise InputError("bounds", f"is {box.tolist()}", rule)
    return corners


def check_pairs(edges: ArrayLike, vertices: Floats) -> Ints:
    """Return edges as vertex indices, shape (m, 2).

    Raises InputError if they have another shape, or an index is not that of a vertex.
    """
    pairs = check_real(edges, "edges", ("start", "end"))
    # numpy makes an empty list an array of floats, shape (0,).
    if pairs.size == 0:
        pairs = np.empty((0, 2), dtype=np.int64)
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2 or vertices.ndim != 2:
        problem = (
            f"has shape {pairs.shape} and type {pairs.dtype}, for vertices of shape "
            f"{vertices.shape}"
        )
        rule = "each edge must be two whole numbers, and vertices a list of configurations"
        raise InputError("edges", problem, rule)
    wrong = (pairs < 0) | (pairs >= len(vertices))
    if wrong.any():
        row = int(wrong.any(axis=1).argmax())  # the first one
        pair = tuple(pairs[row].tolist())
        rule = f"there are {len(vertices)} vertices, counted from 0"
        raise InputError("edge", f"number {row} is {pair}", rule)
    return pairs.astype(np.int64, copy=False)


def check_kind(array: Any, name: str) -> None:
    """Raise InputError for what converts to an array, but has other rows, labels or gaps."""
    check_unmasked(array, name)
    if "image" in type(array).__name__.lower():  # of Pillow, Open3D, SimpleITK
        raise make_kind_error(array, name, "cells are an array indexed [x, y], 1 if occupied")
    if hasattr(array, "todense"):  # a sparse array
        raise make_kind_error(array, name, "it must have a value for each cell")
    if list_columns(array) or hasattr(array, "columns") or hasattr(array, "data_vars"):
        raise make_kind_error(array, name, "its labels are not read")


def check_dims(array: Any, name: str) -> None:
    """Raise InputError unless an array of cells is indexed x, y (and z), as far as it says.

    Dimensions may have no coordinates, which :func:`cspace._files.rasters.place_raster` evaluates
    and removes.
    """
    check_kind(array, name)
    dims = list_dimensions(array)
    if any(dims) and dims != tuple(AXES[k] if dim else "" for k, dim in enumerate(dims[:3])):
        rule = "they must be x, y (and z), in this order"
        raise InputError(name, f"has the dimensions {dims}", rule)
    if hasattr(array, "sel") and set(dims) & set(array.coords):
        raise InputError(name, "has coordinates", "they have no effect here")


def check_cells(values: ArrayLike, name: str) -> Bools:
    """Return a read-only boolean array of 2 or 3 axes.

    It is a copy, unless the array itself can be used. Raises InputError if it has other axes, no
    cells, or values other than 0 and 1.
    """
    check_dims(values, name)
    rule = "it must have the axes x, y (and z), and at least one cell"
    try:
        array = np.asarray(values)
    except (ValueError, RuntimeError) as error:
        problem = f"is ragged, or sparse within: {error}"
        raise InputError(name, problem, "it must have a value for each cell") from error
    if not array.ndim:
        raise make_kind_error(values, name, rule)
    if array.ndim > 3 or array.ndim < 2 or array.size == 0:
        problem = f"is a {type(values).__name__} of {array.ndim} axes and {array.size} entries"
        raise InputError(name, problem, rule, suggest_call(values, name))
    if array.dtype.kind == "f":
        check_finite(array, name)
    if array.dtype.kind not in "biu":
        problem, rule = f"has dtype {array.dtype}", "cells must be boolean"
        raise InputError(name, problem, rule, suggest_call(values, name))
    is_boolean = array.dtype.kind == "b"
    if not is_boolean:
        _check_zeros_and_ones(array, name)
    # A boolean array may contain bytes other than 0 and 1; comparing bytes with 0 normalises them.
    stored_values = array.view(np.uint8) if is_boolean else array
    # An array that is read-only and no view cannot be changed, so it needs no copy.
    is_constant = array.base is None and not array.flags.writeable and array.flags.c_contiguous
    if is_constant and is_boolean and stored_values.max() <= 1:
        return array
    return frozen(np.ascontiguousarray(stored_values != 0))


def _check_zeros_and_ones(array: NDArray[Any], name: str) -> None:
    """Raise InputError for numbers other than 0 and 1."""
    wrong = (array != 0) & (array != 1)
    if not wrong.any():
        return
    entry, value = _first_wrong_entry(array, name, wrong)
    # Occupancy grids of ROS get a message of their own.
    problem = f"is {value}"
    rule = "whole numbers must be 0 or 1"
    # Value of unknown cells in occupancy grids of ROS.
    unknown_cell = -1
    if (array == unknown_cell).any():
        problem = f"{problem}, and some cells are {unknown_cell}, as unknown cells of ROS"
        rule = f"{rule}, and unknown cells may hide obstacles"
    raise InputError(entry, problem, rule)
