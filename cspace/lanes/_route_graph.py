"""Route graphs: nodes, and lanes between them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cspace.errors import InputError
from cspace.inside import (
    AXES,
    ContentError,
    Floats,
    Ints,
    StrPath,
    check_finite,
    check_points,
    check_real,
    names_options,
    warn_of_large,
    wrap_angles,
)
from cspace.lanes._headings import (
    Heading,
    HeadingRule,
    Lane,
    find_repeated,
    parse_heading,
    reverse_lane,
)


@dataclass(frozen=True, eq=False)
class RouteGraph:
    """A graph of nodes and lanes along which robots drive.

    Attributes
    ----------
    names : tuple of str
        Names of the nodes.
    positions : ndarray of float64, shape (n, 2)
        Metres, in the frame of the map.
    lanes : tuple of Lane
        Edges, one for each direction.
    yaws : ndarray of float64, shape (n,)
        Yaw at which a robot stands at a node, radians; NaN if the graph does not say.
    stations : mapping of str to tuple of str
        Nodes of each station.
    node_mutexes : mapping of str to str
        Mutex group of each node that has one.
    yaw_deviations : mapping of str to float
        Largest deviation from the yaw of each node that allows one, radians.

    Examples
    --------
    >>> from cspace.lanes import RouteGraph
    >>> graph = RouteGraph.from_arrays([(0, 0), (4, 0), (4, 3)], [(0, 1), (1, 2)], two_way=True)
    >>> graph
    RouteGraph(3 nodes, 4 lanes)
    """

    names: tuple[str, ...]
    positions: Floats
    lanes: tuple[Lane, ...]
    yaws: Floats
    stations: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    node_mutexes: Mapping[str, str] = field(default_factory=dict)
    yaw_deviations: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def _places(self) -> list[tuple[float, float]]:
        """Positions of the nodes as numbers."""
        return [(x, y) for x, y in self.positions.tolist()]

    @cached_property
    def _stops(self) -> list[tuple[float, ...]]:
        """Yaws of each node, between which lie all that it allows; empty for any yaw."""
        stops: list[tuple[float, ...]] = []
        for name, yaw in zip(self.names, self.yaws.tolist(), strict=True):
            width = self.yaw_deviations.get(name, 0.0)
            ways = (yaw - width, yaw, yaw + width) if width else (yaw,)
            stops.append(() if math.isnan(yaw) else ways)
        return stops

    def __repr__(self) -> str:
        """Return the numbers of nodes and lanes."""
        return f"RouteGraph({len(self.names)} nodes, {len(self.lanes)} lanes)"

    @classmethod
    @names_options
    def open(
        cls,
        path: StrPath,
        *,
        heading: Heading | None = None,
        level: str | None = None,
        vehicle: str | None = None,
    ) -> RouteGraph:
        """Read a route graph of Nav2, Open-RMF, LIF or VDA 5050.

        Parameters
        ----------
        path : str or Path
            A Nav2 route graph (``.geojson``), an Open-RMF navigation graph (``.yaml``), or a LIF
            layout or a VDA 5050 order (``.json``).
        heading : str or float, optional
            Yaw on lanes for which the file does not give one: "forward", "backward", "both", "any"
            or radians. Default: "forward" for Nav2, "both" for Open-RMF, which may drive either
            way, and "any" for LIF and VDA 5050, as LIF demands.
        level : str, optional
            Level, layout or map to read, if the file has several.
        vehicle : str, optional
            Type of vehicle, if a LIF file has several.

        Raises
        ------
        FileError
            If the file is damaged, or asks for something that an audit does not honour; the message
            names the node or the edge.
        """
        from cspace.lanes._graph_files import read_graph

        rule = None if heading is None else parse_heading(heading)
        return cls(**read_graph(path, rule, level, vehicle))

    @classmethod
    @names_options
    def from_arrays(
        cls,
        positions: ArrayLike,
        edges: ArrayLike,
        headings: Heading | HeadingRule | Sequence[Heading | HeadingRule] = "forward",
        *,
        two_way: bool = False,
        names: Sequence[str] | None = None,
        edge_names: Sequence[str] | None = None,
        yaws: ArrayLike | None = None,
    ) -> RouteGraph:
        """Make a graph of straight lanes.

        Parameters
        ----------
        positions : array-like, shape (n, 2)
            Nodes, metres.
        edges : array-like of int, shape (m, 2)
            Indices of the nodes at which each edge starts and ends.
        headings : str or float, or a sequence of m of them
            Yaw on each edge: "forward", "backward", "both", "any" or radians.
        two_way : bool
            Whether the robot drives every edge in both directions.
        names, edge_names : sequence of str, optional
            Default: the indices.
        yaws : array-like, shape (n,), optional
            Yaw at which the robot stands at each node, radians; NaN if it is free.

        Raises
        ------
        InputError
            If an argument has another shape, or names are not unique.
        """
        points = check_points(positions, "positions", AXES[:2])
        check_finite(points, "positions", largest=1e100)  # whose square is finite
        ends = _check_edges(edges, len(points))
        is_one = isinstance(headings, str | HeadingRule) or not np.iterable(headings)
        rules: Iterable[Any] = [headings] * len(ends) if is_one else list(headings)  # type: ignore[arg-type]
        labels = list(map(str, range(len(ends)) if edge_names is None else edge_names))
        nodes = list(map(str, range(len(points)) if names is None else names))
        lanes = []
        _check_length("headings", rules, len(ends))
        _check_length("edge_names", labels, len(ends))
        _check_length("names", nodes, len(points))
        for k, (label, (start, end), rule) in enumerate(
            zip(labels, ends.tolist(), rules, strict=True)
        ):
            heading = parse_heading(rule, "headings" if is_one else f"headings[{k}]")
            lane = Lane(label, start, end, heading)
            lanes += [lane, reverse_lane(lane)] if two_way else [lane]
        for name, values in (("names", nodes), ("edge_names", labels)):
            twice = find_repeated(values)
            if twice is not None:
                raise InputError(name, f"has {twice!r} twice", "names must differ")
        still = np.full(len(points), math.nan)
        if yaws is not None:
            still = check_real(yaws, "yaws").astype(np.float64)
            if still.shape != (len(points),):
                rule = f"it must have {len(points)} numbers, one for each node"
                raise InputError("yaws", f"has shape {still.shape}", rule)
            check_finite(still[~np.isnan(still)], "yaws")
            warn_of_large(still, "rad", "yaws: one")
            still = wrap_angles(still)
        return cls(tuple(nodes), points, tuple(lanes), still)

    @classmethod
    def from_networkx(cls, graph: Any) -> RouteGraph:
        """Make a graph of straight lanes from networkx.

        Nodes have the attribute ``pos``, a pair of metres, or ``x`` and ``y``, and perhaps ``yaw``.
        Edges may have a ``heading``, by default "forward". The robot drives the edges of an
        undirected graph in both directions. Edges with a ``geometry`` are refused.

        Raises
        ------
        InputError
            If a node has no position, or an attribute is wrong; the message names the element.
        GeometryError
            If the graph has a ``crs`` in degrees.
        """
        from cspace.lanes._graph_files import read_networkx

        if not hasattr(graph, "edges"):
            raise InputError("graph", f"is a {type(graph).__name__}", "it must be a graph")
        try:
            return cls.from_arrays(**read_networkx(graph))
        except ContentError as error:
            raise InputError("graph", *error.parts) from error


def _check_length(name: str, values: Any, count: int) -> None:
    """Raise InputError unless each element has one value."""
    if len(values) != count:
        raise InputError(name, f"has {len(values)} entries", f"it must have {count}")


def _check_edges(edges: ArrayLike, count: int) -> Ints:
    """Return lanes as pairs of nodes, shape (m, 2).

    Raises InputError if they have another shape, or an index is not below ``count``.
    """
    pairs = check_real(edges, "edges", ("start", "end"))
    # numpy makes an empty list an array of floats, shape (0,).
    pairs = pairs if pairs.size else np.empty((0, 2), dtype=np.int64)
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2:
        problem = f"has shape {pairs.shape} and type {pairs.dtype}"
        raise InputError("edges", problem, "each edge must be two whole numbers")
    for number, row in enumerate(pairs.tolist()):
        if not 0 <= min(row) <= max(row) < count:
            rule = f"there are {count} vertices, counted from 0"
            raise InputError("edge", f"number {number} is {tuple(row)}", rule)
    return pairs.astype(np.int64, copy=False)
