"""Conflicts of route graphs: lanes and nodes that two robots may not use at once, and zones."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cspace.errors import InputError
from cspace.inside import (
    Floats,
    Ints,
    StrPath,
    check_known,
    check_not_negative,
    check_text,
    names_options,
    show_png,
    warn_user,
    wrap_angles,
)
from cspace.lanes._audit import line_of
from cspace.lanes._lane_motions import open_graph
from cspace.lanes._outlines import ROUNDING, Sweeper, find_touches, make_sweeper
from cspace.lanes._reports import (
    JunitCase,
    format_table,
    format_value,
    make_features,
    write_csv,
    write_junit,
)
from cspace.lanes._route_graph import RouteGraph

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.inside import ConfigurationMap

PairState: TypeAlias = Literal["apart", "touch", "undecided"]
"""Verdicts about two elements."""

Pose: TypeAlias = tuple[float, ...]
"""A configuration: x, y, and a yaw if the map has one; metres and radians."""

COLORS: Final = {"touch": "#c4161c", "undecided": "#e08a00"}
"""Colors of places in pictures, by verdict."""

COLUMNS: Final = (
    *("first", "second", "verdict", "shares_node", "groups"),
    *("at", "first_pose", "second_pose"),
)
"""Columns of tables, for each pair that is not apart."""


class Element(NamedTuple):
    """A lane in one direction, or a node with its turns, for one robot.

    Attributes
    ----------
    robot : str
        Name of the robot; empty if it has none.
    kind : str
        "lane" or "node".
    nodes : tuple of tuple of float
        Positions of its nodes, metres.
    group : str
        Mutex group of the file; empty without one.
    line : ndarray of float64, shape (n, 2)
        Points to draw.
    """

    robot: str
    kind: str
    nodes: tuple[tuple[float, float], ...]
    group: str
    line: Floats


class Conflict(NamedTuple):
    """Verdict about two elements.

    Attributes
    ----------
    first, second : str
        Names of the elements.
    verdict : str
        "apart": proven for all poses; "touch": two poses at which the robots overlap, or are within
        the margin; otherwise "undecided".
    shares_node : bool
        Whether the elements have a node at the same position.
    groups : tuple of str
        Mutex groups that both are in.
    at : tuple of float or None
        A point of both robots, or where it is undecided, metres.
    poses : tuple of tuple of float, or None
        The two poses, if they touch.
    """

    first: str
    second: str
    verdict: PairState
    shares_node: bool
    groups: tuple[str, ...] = ()
    at: tuple[float, float] | None = None
    poses: tuple[Pose, Pose] | None = None

    @property
    def _cells(self) -> dict[str, Any]:
        """Values of the table, by columns."""
        poses = self.poses or (None, None)
        groups = " ".join(self.groups)
        row = self.first, self.second, self.verdict, self.shares_node, groups, self.at, *poses
        return dict(zip(COLUMNS, row, strict=True))


@dataclass(frozen=True, eq=False)
class Conflicts:
    """Pairs of lanes and nodes on which two robots can touch.

    Attributes
    ----------
    margin : float
        Distance that two robots must keep, metres.
    elements : dict of str to Element
        Lanes and nodes by their names, such as "7: a to b" and "node a", or "tug node a" of a robot
        with a name. Names that repeat are numbered, as "7: a to b (2)".
    outlines : dict of str to shapely geometry
        A polygon, in metres, proven to hold the robot, with its margin, everywhere on an element;
        of several polygons for a robot in several parts.
    pairs : list of Conflict
        All pairs of different elements that are not proven apart.
    """

    _robots: Mapping[str, tuple[ConfigurationMap, RouteGraph]] = field(repr=False)
    margin: float
    elements: dict[str, Element]
    outlines: dict[str, BaseGeometry]
    pairs: list[Conflict]
    _stands: dict[str, Pose] = field(repr=False)

    @property
    def counts(self) -> dict[str, int]:
        """Number of pairs of different elements by verdict."""
        counts = Counter(row.verdict for row in self.pairs)
        total = len(self.elements) * (len(self.elements) - 1) // 2
        others = {verdict: counts[verdict] for verdict in ("touch", "undecided")}
        return {"apart": total - len(self.pairs), **others}

    def between(self, first: str, second: str) -> Conflict:
        """Return the verdict about two elements; an element touches itself.

        Raises
        ------
        InputError
            If there is no such element.
        """
        for name, argument in ((first, "first"), (second, "second")):
            check_known(name, argument, self.elements)
        ends = first, second
        if first == second:
            pose = self._stands[first]
            group = self.elements[first].group
            groups = (group,) if group else ()
            return Conflict(*ends, "touch", True, groups, (pose[0], pose[1]), (pose, pose))
        if ends in self._rows:
            return self._rows[ends]
        if ends[::-1] in self._rows:
            row = self._rows[ends[::-1]]
            poses = row.poses and row.poses[::-1]
            return row._replace(first=first, second=second, poses=poses)
        both = self.elements[first], self.elements[second]
        return Conflict(*ends, "apart", _share_node(*both), _share_groups(*both))

    @cached_property
    def _rows(self) -> dict[tuple[str, str], Conflict]:
        """Pairs that are not apart, by the names of their elements."""
        return {(row.first, row.second): row for row in self.pairs}

    @property
    def groups(self) -> dict[str, list[str]]:
        """Elements of each mutex group that the files have."""
        found: dict[str, list[str]] = {}
        for name, element in self.elements.items():
            if element.group:
                found.setdefault(element.group, []).append(name)
        return found

    @property
    def unguarded(self) -> list[Conflict]:
        """Pairs that touch and share neither a node nor a mutex group."""
        return [
            row
            for row in self.pairs
            if row.verdict == "touch" and not (row.groups or row.shares_node)
        ]

    def zones(self) -> Zones:
        """Return zones that keep robots apart, one robot in each.

        A robot is in a zone as long as any point of it, or of its margin, is. If two robots on
        different elements are within the margin of each other, the line between their nearest
        points lies where the outlines, grown by the margin, overlap. A zone is a connected part
        of these overlaps, without holes, so both robots are in it.
        """
        found = _grow(np.array(list(self.outlines.values()), dtype=object), self.margin)
        numbers = {name: k for k, name in enumerate(self.elements)}
        ends = np.array([(numbers[row.first], numbers[row.second]) for row in self.pairs])
        first, second = ends.reshape(-1, 2).astype(np.int64).T
        overlaps = shapely.intersection(found[first], found[second])
        # A zone without holes may hold other zones, so zones are united again.
        polygons = _fill(_fill(overlaps))
        tree = shapely.STRtree(polygons)
        members: list[set[str]] = [set() for _ in polygons]
        names = list(self.elements)
        for pair, zone in tree.query(overlaps, predicate="intersects").T.tolist():
            members[zone] |= {names[first[pair]], names[second[pair]]}
        most = max(map(len, members), default=0)
        # Lanes that meet at nodes join their overlaps; a few of them are a crossing.
        # Number of elements of a zone up to which its size is expected.
        if most > max(16, len(names) // 2):
            text = (
                f"zones: one zone has {most} of {len(names)} elements; one robot enters at a time"
            )
            warn_user(text)
        return Zones(tuple(polygons), tuple(tuple(sorted(each)) for each in members))

    @property
    def _summary(self) -> str:
        """Robots and numbers of pairs by verdict."""
        names = " and ".join(space.robot.name for space, _ in self._robots.values())
        numbers = ", ".join(f"{count} {verdict}" for verdict, count in self.counts.items())
        return f"{names}: {numbers}"

    def __repr__(self) -> str:
        """Return robots and numbers of pairs by verdict."""
        return f"Conflicts({self._summary})"

    def __str__(self) -> str:
        """Return tables of pairs that are not apart, and of mutexes."""
        order = sorted(self.pairs, key=lambda row: (bool(row.groups), row.shares_node))
        lines = [repr(self)]
        lines += format_table(
            COLUMNS[:-2], [list(row._cells.values())[:-2] for row in order], "pairs"
        )
        if self.groups:
            lines.append(f"{len(self.unguarded)} pairs touch and share no node and no mutex group")
        used = {group for row in self.pairs for group in row.groups}
        shared = (name for name, members in self.groups.items() if len(members) > 1)
        needless = [name for name in shared if name not in used]
        if needless:
            lines.append(f"mutex groups that guard nothing: {', '.join(needless)}")
        return "\n".join(lines)

    def plot(self) -> Axes:
        """Draw the map with all lanes, and the places where robots touch.

        Places of pairs that share a node are grey.

        Returns
        -------
        matplotlib.axes.Axes
        """
        from cspace.plot import extend_legend

        space, _ = next(iter(self._robots.values()))
        axes = space.plot(title=f"Pairs of lanes and nodes, {self._summary}")
        for element in self.elements.values():
            axes.plot(*element.line.T, ".-", color="#1f4e79", linewidth=1.0, ms=4, zorder=5)
        for verdict, color in COLORS.items():
            for shares, fill in ((True, "#8c8c8c"), (False, color)):
                rows = [
                    row for row in self.pairs if (row.verdict, row.shares_node) == (verdict, shares)
                ]
                common = [
                    shapely.intersection(self.outlines[row.first], self.outlines[row.second])
                    for row in rows
                ]
                label = f"{len(rows)} {verdict}{', with a common node' if shares else ''}"
                is_filled = _fill_shapes(axes, common, fill, label)
                if rows and not (shares and is_filled):
                    places = np.array([row.at for row in rows])
                    style: dict[str, Any] = {"color": fill, "markeredgecolor": "white", "ms": 7}
                    axes.plot(*places.T, "X", label="" if is_filled else label, zorder=7, **style)
        extend_legend(axes, axes.get_legend_handles_labels()[0])
        return axes

    _repr_png_ = show_png

    @names_options
    def to_geojson(self, path: StrPath | None = None, overwrite: bool = False) -> dict[str, Any]:
        """Return outlines as polygons and pairs as points, metres; write them to a path."""
        shapes: list[tuple[Mapping[str, Any], Mapping[str, Any]]] = []
        for name, outline in self.outlines.items():
            element = self.elements[name]
            properties = {"element": name, "kind": element.kind, "group": element.group}
            shapes.append((shapely.geometry.mapping(shapely.orient_polygons(outline)), properties))
        shapes += [
            ({"type": "Point", "coordinates": list(row.at or ())}, row._cells) for row in self.pairs
        ]
        return make_features(shapes, path, overwrite)

    @names_options
    def to_csv(self, path: StrPath, overwrite: bool = False) -> None:
        """Write one row for each pair not apart."""
        write_csv(path, overwrite, COLUMNS, (row._cells for row in self.pairs))

    @names_options
    def to_junit(self, path: StrPath, overwrite: bool = False, strict: bool = False) -> None:
        """Write a JUnit report of conflicts without common nodes.

        If a file has mutex groups, a pair that touches and shares none fails. An undecided pair
        that shares none is skipped, or fails if ``strict``.
        """
        failing = {(row.first, row.second) for row in self.failing(strict)}
        cases = []
        for row in self.pairs:
            if not row.shares_node:
                text = f"{row.verdict} at {format_value(row.at)}, with no mutex group in common"
                is_open = bool(self.groups) and not row.groups
                name = f"{row.first} and {row.second}"
                fails = (row.first, row.second) in failing
                cases.append(JunitCase(name, text if is_open else "", fails))
        write_junit(path, overwrite, repr(self), "conflicts", cases)

    @names_options
    def failing(self, strict: bool = False) -> list[Conflict]:
        """Return pairs that touch though mutex groups should keep the robots apart.

        These share no node and no group; if ``strict``, undecided pairs count, too. There are none
        if no file has groups.
        """
        wrong = ("touch", "undecided") if strict else ("touch",)
        return [
            row
            for row in self.pairs
            if self.groups and row.verdict in wrong and not (row.groups or row.shares_node)
        ]


@dataclass(frozen=True, eq=False)
class Zones:
    """Polygons that one robot at a time may enter.

    Attributes
    ----------
    polygons : tuple of shapely polygons
        Metres, without holes; no two meet.
    elements : tuple of tuple of str
        Lanes and nodes that pass each zone.
    """

    polygons: tuple[shapely.Polygon, ...]
    elements: tuple[tuple[str, ...], ...]

    def __len__(self) -> int:
        """Return the number of zones."""
        return len(self.polygons)

    @names_options
    def to_geojson(self, path: StrPath | None = None, overwrite: bool = False) -> dict[str, Any]:
        """Return the zones as polygons, in metres of the map's frame; write them to a path."""
        rows = enumerate(zip(self.polygons, self.elements, strict=True))
        shapes = (
            (shapely.geometry.mapping(polygon), {"zone": k, "elements": list(names)})
            for k, (polygon, names) in rows
        )
        return make_features(shapes, path, overwrite)

    def to_vda5050(self, map_id: str, zone_set_id: str) -> dict[str, Any]:
        """Return the ``zoneSet`` of VDA 5050, version 3, with release zones.

        The fleet control adds the header, and releases each zone to one robot at a time.
        """
        zones = [
            {
                "zoneId": str(k),
                "zoneType": "RELEASE",
                "vertices": [{"x": x, "y": y} for x, y in _corners_of(polygon)],
            }
            for k, polygon in enumerate(self.polygons)
        ]
        names = {
            "mapId": check_text(map_id, "map_id"),
            "zoneSetId": check_text(zone_set_id, "zone_set_id"),
        }
        return {"zoneSet": {**names, "zones": zones}}


@names_options
def conflicts(
    space: ConfigurationMap,
    graph: RouteGraph | StrPath | Any,
    *,
    others: Mapping[str, tuple[ConfigurationMap, RouteGraph | StrPath | Any]] | None = None,
    margin: float = 0.0,
    name: str = "",
) -> Conflicts:
    """Prove which lanes and nodes two robots can use at once.

    Two robots can touch on two elements, lanes with a direction or nodes with their turns, if and
    only if the shapes that they sweep there meet. Each pair is proven apart, or has two poses that
    touch, or is undecided. Robots are as of the map: grown by its margin, and off the lane by what
    the graph allows. Robots of one kind also meet each other. A robot on a floor is apart where its
    footprint is, and else undecided. See :class:`cspace.lanes.Conflicts`.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        A map with the axes x, y, or x, y, yaw.
    graph : cspace.lanes.RouteGraph, str, Path or networkx graph
        Lanes, as for :func:`cspace.lanes.audit`.
    others : mapping of str to tuple, optional
        Map and graph of each other kind of robot, by its name.
    margin : float
        Distance that two robots must keep, metres.
    name : str
        Name of this robot, with which the names of its lanes and nodes then begin.

    Returns
    -------
    cspace.lanes.Conflicts

    Raises
    ------
    InputError
        As for :func:`cspace.lanes.audit`; or if maps differ in their frame or extent.
    FileError
        If a file is damaged, or asks for something that is not honoured.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> from cspace.lanes import RouteGraph
    >>> workspace = cspace.Workspace.from_array(np.zeros((80, 60), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, "rect:0.6x0.4", rotations=72)
    >>> nodes = [(1, 2), (7, 2), (1, 2.3), (7, 2.3), (1, 4), (7, 4)]
    >>> graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3), (4, 5)])
    >>> conflicts = cspace.lanes.conflicts(space, graph)
    >>> conflicts.between("0: 0 to 1", "1: 2 to 3").verdict
    'touch'
    >>> conflicts.between("0: 0 to 1", "2: 4 to 5").verdict
    'apart'
    """
    gap = check_not_negative(margin, "margin")
    given = _check_robots({} if others is None else others, name)
    robots = {name: (space, open_graph(space, graph, "graph"))}
    for key, (other, lanes) in given.items():
        robots[key] = other, open_graph(other, lanes, f"others[{key!r}]")
        _check_same_map(space, other, key)
    sweepers = [make_sweeper(*each) for each in robots.values()]
    elements = _list_elements(robots)
    outlines: Any = np.concatenate([sweeper.outlines for sweeper in sweepers])
    stands = [
        pose
        for sweeper, (each, _) in zip(sweepers, robots.values(), strict=True)
        for pose in _list_poses(each, sweeper.pieces.starts[sweeper.begins[:-1]])
    ]
    return Conflicts(
        _robots=robots,
        margin=gap,
        elements=elements,
        outlines=dict(zip(elements, outlines.tolist(), strict=True)),
        pairs=_judge_pairs(list(robots.values()), sweepers, elements, gap),
        _stands=dict(zip(elements, stands, strict=True)),
    )


def _check_robots(others: Any, known: object) -> dict[str, tuple[Any, Any]]:
    """Return other robots by name, or raise InputError."""
    if not isinstance(known, str):
        raise InputError("name", f"is a {type(known).__name__}", "it must be a string")
    rule = "it must give a map and a graph by a name of each robot"
    if not isinstance(others, Mapping):
        raise InputError("others", f"is a {type(others).__name__}", rule)
    for name, pair in others.items():
        if not (isinstance(name, str) and name) or name == known:
            raise InputError("others", f"has the name {name!r}", rule)
        if not (isinstance(pair, tuple | list) and len(pair) == 2):
            raise InputError(f"others[{name!r}]", f"is a {type(pair).__name__}", rule)
    return dict(others)


def _check_same_map(space: ConfigurationMap, other: ConfigurationMap, name: str) -> None:
    """Raise InputError unless two maps have one frame and one extent."""
    if other.frame_id != space.frame_id:
        problem = f"has the frame {other.frame_id!r}, but space has {space.frame_id!r}"
        raise InputError(f"others[{name!r}]", problem, "positions must be in one frame")
    corners = np.array([[*each.grid.lower, *each.grid.upper] for each in (space, other)])
    if np.abs(np.diff(corners, axis=0)).max() > max(space.grid.spacing, other.grid.spacing):
        low, high = corners[1].reshape(2, 2).tolist()
        problem = f"has a map from {low} to {high}"
        rule = f"that of space is from {list(space.grid.lower)} to {list(space.grid.upper)}"
        raise InputError(f"others[{name!r}]", problem, rule)


def _list_elements(robots: Mapping[str, tuple[Any, RouteGraph]]) -> dict[str, Element]:
    """List each robot's lanes, then its nodes, by unique names."""
    elements: dict[str, Element] = {}
    repeats: Counter[str] = Counter()
    for robot, (_, graph) in robots.items():
        for element_name, element in _name_elements(robot, graph):
            name = f"{robot} {element_name}" if robot else element_name
            unique = name
            while unique in elements:
                repeats[name] += 1
                unique = f"{name} ({repeats[name] + 1})"
            elements[unique] = element
    return elements


def _name_elements(robot: str, graph: RouteGraph) -> Iterator[tuple[str, Element]]:
    """Yield the lanes of a graph, then its nodes, each after its name."""
    for number, lane in enumerate(graph.lanes):
        ends = lane.start, lane.end
        start, end = (graph.names[node] for node in ends)
        nodes = tuple(graph._places[node] for node in ends)
        element = Element(robot, "lane", nodes, lane.mutex, line_of(graph, number))
        yield f"{lane.name}: {start} to {end}", element
    for node, place in zip(graph.names, graph._places, strict=True):
        group = graph.node_mutexes.get(node, "")
        yield f"node {node}", Element(robot, "node", (place,), group, np.array([place]))


def _judge_pairs(
    robots: Sequence[tuple[ConfigurationMap, RouteGraph]],
    sweepers: list[Sweeper],
    elements: dict[str, Element],
    distance: float,
) -> list[Conflict]:
    """Return verdicts about all pairs that are not apart."""
    begins = np.cumsum([0, *(len(sweeper.outlines) for sweeper in sweepers)])
    # Where footprints meet, a robot on a floor may still pass under the other.
    has_floor = [space.floor is not None for space, _ in robots]
    names, kinds = list(elements), list(elements.values())
    pairs: list[Conflict] = []
    for one, other in itertools.combinations_with_replacement(range(len(sweepers)), 2):
        first, second = _find_near(sweepers[one], sweepers[other], distance)
        touches = find_touches(sweepers[one], first, sweepers[other], second, distance)
        proven = touches.found & (not (has_floor[one] or has_floor[other]))
        poses = zip(
            _list_poses(robots[one][0], touches.first),
            _list_poses(robots[other][0], touches.second),
            strict=True,
        )
        places = (first + begins[one]).tolist(), (second + begins[other]).tolist()
        ends = proven.tolist(), touches.points.tolist()
        for a, b, found, (x, y), both in zip(*places, *ends, poses, strict=True):
            verdict: PairState = "touch" if found else "undecided"
            shared = _share_node(kinds[a], kinds[b]), _share_groups(kinds[a], kinds[b])
            row = Conflict(names[a], names[b], verdict, *shared, (x, y), both if found else None)
            pairs.append(row)
    return pairs


def _list_poses(space: ConfigurationMap, poses: Floats) -> list[Pose]:
    """Return poses (n, 3) as configurations of a map."""
    wrapped = np.column_stack([poses[:, :2], wrap_angles(poses[:, 2])])
    return [tuple(pose) for pose in wrapped[:, : space.size].tolist()]


def _find_near(one: Sweeper, other: Sweeper, distance: float) -> tuple[Ints, Ints]:
    """Return pairs of two robots' elements not proven apart."""
    tree = shapely.STRtree(other.outlines)
    if distance > 0.0:
        reach = distance + ROUNDING
        found = tree.query(one.outlines, predicate="dwithin", distance=reach)
    else:
        found = tree.query(one.outlines, predicate="intersects")
    if one is other:
        found = found[:, found[0] < found[1]]
    first, second = found[:, np.lexsort(found[::-1])]
    return first, second


def _share_node(one: Element, other: Element) -> bool:
    """Return True if two elements have a node at the same position."""
    return not set(one.nodes).isdisjoint(other.nodes)


def _share_groups(one: Element, other: Element) -> tuple[str, ...]:
    """Return the common mutex groups of two elements."""
    return (one.group,) if one.group and one.group == other.group else ()


def _grow(outlines: Any, margin: float) -> Any:
    """Return polygons, shape (n,), that hold all points within a margin of outlines."""
    if not margin:
        return outlines
    # Chords of up to 8.4 degrees replace arcs, and leave them by 0.27 % of the radius.
    reach = 1.003 * margin + 2.0 * ROUNDING
    grown = shapely.buffer(outlines, reach, quad_segs=16)
    # A grown outline holds all points within the distance of its border.
    holds = shapely.covers(grown, outlines)
    holds &= shapely.distance(shapely.boundary(grown), outlines) >= margin + ROUNDING
    sides = np.array([-reach, -reach, reach, reach])
    return np.where(holds, grown, shapely.box(*(shapely.bounds(outlines) + sides).T))


def _list_polygons(shapes: Any) -> Any:
    """Return the polygons of the union of shapes, shape (n,)."""
    parts = shapely.get_parts(shapely.union_all(shapes))
    return parts[shapely.get_type_id(parts) == shapely.GeometryType.POLYGON]


def _fill(shapes: Any) -> Any:
    """Return a union's polygons without holes, shape (n,)."""
    polygons = _list_polygons(shapes)
    # RFC 7946 and VDA 5050 list corners counterclockwise.
    return shapely.orient_polygons(shapely.polygons(shapely.get_exterior_ring(polygons)))


def _corners_of(polygon: shapely.Polygon) -> list[tuple[float, float]]:
    """Return the corners of a polygon, each once."""
    return [(x, y) for x, y in polygon.exterior.coords[:-1]]


def _fill_shapes(axes: Axes, shapes: Sequence[BaseGeometry], color: str, label: str) -> bool:
    """Fill the union of shapes with a color; return whether it has an area."""
    from shapely.plotting import patch_from_polygon

    polygons = _list_polygons(shapes)
    if len(polygons):
        union = shapely.multipolygons(polygons)
        axes.add_patch(patch_from_polygon(union, color=color, alpha=0.6, label=label, zorder=4))
    return len(polygons) > 0
