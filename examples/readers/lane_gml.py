"""Read a graph of lanes in GML, with networkx; each node needs ``pos``, metres."""

import networkx

from cspace.lanes import RouteGraph


def read_lanes(path: str) -> RouteGraph:
    """Read the nodes, and an edge for each lane."""
    return RouteGraph.from_networkx(networkx.read_gml(path))


if __name__ == "__main__":
    import sys

    print(read_lanes(sys.argv[1]))
