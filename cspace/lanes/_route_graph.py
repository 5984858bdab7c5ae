"""Route graphs: nodes, and lanes between them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._support.arrays import Floats, StrPath
from cspace._support.check import check_finite, check_points
from cspace.errors import InputError
from cspace.lanes._headings import Heading, HeadingRule, Lane, find_repeated, parse_heading


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

    @cached_property
    def places(self) -> list[tuple[float, float]]:
        """Positions of the nodes as numbers."""
        return [(x, y) for x, y in self.positions.tolist()]

    def __repr__(self) -> str:
        """Return the numbers of nodes and lanes."""
        return f"RouteGraph({len(self.names)} nodes, {len(self.lanes)} lanes)"

    @classmethod
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
        return cls(*read_graph(path, rule, level, vehicle))

    @classmethod
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
        points, ends = _check_edges(positions, edges)
        is_one = isinstance(headings, str | int | float | np.number | HeadingRule)
        rules: Iterable[Any] = [headings] * len(ends) if is_one else list(headings)  # type: ignore[arg-type]
        labels = [str(k) for k in range(len(ends))] if edge_names is None else list(edge_names)
        nodes = [str(k) for k in range(len(points))] if names is None else list(names)
        lanes = []
        _check_length("headings", rules, len(ends))
        _check_length("edge_names", labels, len(ends))
        _check_length("names", nodes, len(points))
        for k, (label, (start, end), rule) in enumerate(
            zip(labels, ends.tolist(), rules, strict=True)
        ):
            heading = parse_heading(rule, "headings" if is_one else f"headings[{k}]")
            lane = Lane(str(label), start, end, heading)
            lanes += [lane, lane.reverse()] if two_way else [lane]
        for name, values in (("names", nodes), ("edge_names", labels)):
            twice = find_repeated(values)
            if twice is not None:
                raise InputError(name, f"has {twice!r} twice", "names must differ")
        still = np.full(len(points), math.nan)
        if yaws is not None:
            still = np.array(yaws, dtype=np.float64)
            _check_length("yaws", still, len(points))
            check_finite(still[~np.isnan(still)], "yaws")
        return cls(tuple(map(str, nodes)), points, tuple(lanes), still)

    @classmethod
    def from_networkx(cls, graph: Any) -> RouteGraph:
        """Make a graph of straight lanes from one of networkx.

        Nodes have the attribute ``pos``, a pair of metres, or ``x`` and ``y``, and perhaps ``yaw``.
        Edges may have a ``heading``, by default "forward". The robot drives the edges of an
        undirected graph in both directions.

        Raises
        ------
        InputError
            If a node has no position, or an attribute is wrong; the message names the element.
        """
        indices = {node: k for k, node in enumerate(graph.nodes)}
        positions = []
        yaws = []
        for node, data in graph.nodes(data=True):
            place = data.get("pos", (data.get("x"), data.get("y")))
            try:
                x, y = map(float, place)
                yaw = float(data.get("yaw", math.nan))
                if not (math.isfinite(x) and math.isfinite(y)) or math.isinf(yaw):
                    raise ValueError
            except (TypeError, ValueError):
                rule = "it needs pos=(x, y), or x and y, metres"
                raise InputError("graph", f"has the node {node!r} at {place!r}", rule) from None
            positions.append((x, y))
            yaws.append(yaw)
        edges = list(graph.edges(data=True))
        return cls.from_arrays(
            np.array(positions).reshape(-1, 2),
            np.array([(indices[a], indices[b]) for a, b, _ in edges], dtype=np.int64).reshape(
                -1, 2
            ),
            [
                parse_heading(data.get("heading", "forward"), f"heading of the edge {a!r}, {b!r}")
                for a, b, data in edges
            ],
            two_way=not graph.is_directed(),
            names=[str(node) for node in graph.nodes],
            yaws=yaws,
        )


def _check_edges(positions: ArrayLike, edges: ArrayLike) -> tuple[Floats, NDArray[Any]]:
    """Return nodes, shape (n, 2), and pairs of their indices, shape (m, 2), if they fit."""
    points = check_points(positions, "positions", 2)
    ends = np.asarray(edges).reshape(-1, 2) if np.size(edges) == 0 else np.asarray(edges)
    if points.ndim != 2:
        raise InputError(
            "positions", f"has shape {points.shape}", "it must be one row for each node"
        )
    is_pairs = ends.ndim == 2 and ends.shape[1] == 2
    if not is_pairs or (ends.size and ends.dtype.kind not in "iu"):
        rule = "it must be pairs of indices of nodes"
        raise InputError("edges", f"has shape {ends.shape} of {ends.dtype}", rule)
    is_known = ((ends >= 0) & (ends < len(points))).all(axis=1)
    if not is_known.all():
        number = int(np.argmin(is_known))
        rule = f"its nodes must be 0 to {len(points) - 1}"
        raise InputError(f"edges[{number}]", f"is {ends[number].tolist()}", rule)
    return points, ends


def _check_length(name: str, values: Any, count: int) -> None:
    """Raise InputError unless there is one value for each element."""
    if len(values) != count:
        raise InputError(name, f"has {len(values)} entries", f"it must have {count}")
