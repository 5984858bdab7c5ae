"""A stand-in for map_msgs, of which there is no wheel: its updates travel as OccupancyGrid.

The fields x and y travel in the origin; width and height, in the info.
"""

from nav_msgs.msg import OccupancyGrid as OccupancyGridUpdate

__all__ = ["OccupancyGridUpdate"]


def add_field(name, read, write):
    """Give the message a field that is kept in others."""
    setattr(OccupancyGridUpdate, name, property(read, write))


add_field(
    "x",
    lambda msg: int(msg.info.origin.position.x),
    lambda msg, value: setattr(msg.info.origin.position, "x", float(value)),
)
add_field(
    "y",
    lambda msg: int(msg.info.origin.position.y),
    lambda msg, value: setattr(msg.info.origin.position, "y", float(value)),
)
add_field("width", lambda msg: msg.info.width, lambda msg, value: setattr(msg.info, "width", value))
add_field(
    "height", lambda msg: msg.info.height, lambda msg, value: setattr(msg.info, "height", value)
)
