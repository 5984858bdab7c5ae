"""Orders of VDA 5050, one for each edition, with the fields of its schema, and zone sets."""

EDITIONS = ("1.1.0", "2.0.0", "2.1.0", "3.0.0")

_ALL = "1.1 2.0 2.1 3.0"
_UNTIL_2 = "1.1 2.0 2.1"

_TABLE = {
    "order": [
        ("headerId", 1, _ALL, _ALL),
        ("timestamp", "2026-01-01T00:00:00.000Z", _ALL, _ALL),
        ("manufacturer", "maker", _ALL, _ALL),
        ("serialNumber", "s1", _ALL, _ALL),
        ("orderId", "o1", _ALL, _ALL),
        ("orderUpdateId", 0, _ALL, _ALL),
        ("zoneSetId", "z1", _UNTIL_2, ""),
        ("orderDescription", "to the dock", "3.0", ""),
    ],
    "node": [
        ("released", True, _ALL, _ALL),
        ("actions", [], _ALL, _ALL),
        ("nodeDescription", "a place", _UNTIL_2, ""),
        ("nodeDescriptor", "a place", "3.0", ""),
    ],
    "nodePosition": [
        ("mapId", "hall", _ALL, _ALL),
        ("theta", 0.5, _ALL, ""),
        ("allowedDeviationXY", 0.25, _UNTIL_2, ""),
        ("allowedDeviationXY", {"a": 0.25, "b": 0.1, "theta": 0.3}, "3.0", ""),
        ("allowedDeviationTheta", 0.2, _ALL, ""),
        ("mapDescription", "the hall", _UNTIL_2, ""),
    ],
    "edge": [
        ("released", True, _ALL, _ALL),
        ("actions", [], _ALL, _ALL),
        ("edgeDescription", "a way", _UNTIL_2, ""),
        ("edgeDescriptor", "a way", "3.0", ""),
        ("maxSpeed", 1.0, _UNTIL_2, ""),
        ("maximumSpeed", 1.0, "3.0", ""),
        ("maxHeight", 2.0, _UNTIL_2, ""),
        ("minHeight", 0.1, _UNTIL_2, ""),
        ("maximumMobileRobotHeight", 2.0, "3.0", ""),
        ("minimumLoadHandlingDeviceHeight", 0.1, "3.0", ""),
        ("orientation", 0.75, _ALL, ""),
        ("orientationType", "GLOBAL", "2.0 2.1 3.0", ""),
        ("direction", "straight", _ALL, ""),
        ("rotationAllowed", False, _UNTIL_2, ""),
        ("reachOrientationBeforeEntering", True, "3.0", ""),
        ("maxRotationSpeed", 0.5, _ALL, ""),
        ("length", 5.0, "2.0 2.1 3.0", ""),
    ],
    "trajectory": [
        ("degree", 1, _ALL, _UNTIL_2),
        ("knotVector", [0.0, 0.0, 1.0, 1.0], _ALL, _UNTIL_2),
    ],
    "controlPoint": [("weight", 1.0, _ALL, ""), ("orientation", 0.1, "1.1", "")],
    "corridor": [
        ("leftWidth", 0.3, "2.1 3.0", "2.1 3.0"),
        ("rightWidth", 0.5, "2.1 3.0", "2.1 3.0"),
        ("corridorRefPoint", "KINEMATICCENTER", "2.1", ""),
        ("corridorReferencePoint", "KINEMATIC_CENTER", "3.0", ""),
        ("releaseRequired", True, "3.0", ""),
        ("releaseLossBehavior", "STOP", "3.0", ""),
    ],
}
"""Fields of each element: value, editions that have the field, and those that require it.

The sources are the JSON schemas of releases 2.0.0, 2.1.0 and 3.0.0, and the text of 1.1.0. Names
and places of nodes, and of the nodes of an edge, are left out.
"""

PLACES = {"a": (1.0, 2.0), "b": (6.0, 2.0), "c": (6.0, 5.0)}


def make_order(version, is_full):
    """Make an order from a to b to c and back to b, with the required fields alone or with all."""
    edition = version[:3]

    def fill(element, **given):
        """Return the fields of an element."""
        return given | {
            name: value
            for name, value, editions, required in _TABLE[element]
            if edition in (editions if is_full else required)
        }

    nodes, edges = [], []
    for number, name in enumerate("abcb"):
        x, y = PLACES[name]
        place = fill("nodePosition", x=x, y=y)
        nodes.append(fill("node", nodeId=name, sequenceId=2 * number, nodePosition=place))
    for number, (first, last) in enumerate(("ab", "bc", "cb")):
        # From version 3 on, edges lie between the nodes before and after them.
        ends = {} if edition == "3.0" else {"startNodeId": first, "endNodeId": last}
        edge = fill("edge", edgeId=f"e{number}", sequenceId=2 * number + 1, **ends)
        if is_full:
            points = [fill("controlPoint", x=x, y=y) for x, y in (PLACES[first], PLACES[last])]
            edge["trajectory"] = fill("trajectory", controlPoints=points)
        if is_full and (corridor := fill("corridor")):
            edge["corridor"] = corridor
        edges.append(edge)
    return fill("order", version=version, nodes=nodes, edges=edges)


SQUARE = [(1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)]


def make_zone(name, kind, corners=SQUARE, **fields):
    """Return a zone."""
    vertices = [{"x": x, "y": y} for x, y in corners]
    return {"zoneId": name, "zoneType": kind, "vertices": vertices, **fields}


def make_zone_set(*zones):
    """Return a zone set as a message."""
    inner = {"mapId": "hall", "zoneSetId": "1", "zoneSetDescriptor": "day", "zones": list(zones)}
    return {
        "headerId": 1,
        "timestamp": "1991-03-11T11:40:03.123Z",
        "version": "3.0.0",
        "manufacturer": "m",
        "serialNumber": "s",
        "zoneSet": inner,
    }
