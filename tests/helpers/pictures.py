"""Contents of figures: pixels, texts, and colours of legend entries."""

import numpy as np
from matplotlib.colors import to_rgb

from cspace import BLOCKED, FREE, MIXED, Workspace, build
from cspace.plot.scene import CellClass
from tests.helpers.handmade import fill_boxes

CLASS_NAMES = {FREE: "free", MIXED: "undecided (MIXED)", BLOCKED: "C-obstacle (BLOCKED)"}
COLORS = {each.label: tuple(round(255 * part) for part in to_rgb(each.color)) for each in CellClass}
TURNING_PATH = [(1.0, 1.0, 0.0), (1.5, 3.5, 1.5), (6.5, 4.0, 0.0)]


def block():
    """Build walls of 8 m by 5 m around a block, x 5 to 6.5, y 1 to 2."""
    sides = np.s_[[0, -1], :], np.s_[:, [0, -1]]
    return Workspace.from_array(fill_boxes((80, 50), *sides, np.s_[50:65, 10:20]), 0.1)


def yard(robot):
    """Build the map of a rotating robot around the block."""
    return build(block(), robot, rotations=24)


def rendered(ax, *, arranged=False):
    """Render a figure to pixels (height, width, 3), first row at the bottom.

    Unless ``arranged``, the layout is not computed, and legends and texts are hidden.
    """
    if not arranged and ax.figure.get_layout_engine() is not None:
        ax.figure.set_layout_engine("none")
        for each in (*ax.figure.legends, *ax.figure.texts):
            each.set_visible(False)
    ax.figure.canvas.draw()
    return np.asarray(ax.figure.canvas.buffer_rgba())[::-1, :, :3]


def pixel(ax, image, x, y):
    """Return the pixel of a point given in metres."""
    column, row = ax.transData.transform((x, y))
    return tuple(image[int(row), int(column)].tolist())


def labels(ax):
    """Return the entries of all legends."""
    legends = [*ax.figure.legends, *([ax.get_legend()] if ax.get_legend() else [])]
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def heading(ax):
    """Return the title of the figure."""
    return str(ax.figure.get_suptitle())


def heading_box(figure):
    """Return the bounding box of the figure's title."""
    (text,) = (each for each in figure.texts if each.get_text() == figure.get_suptitle())
    return text.get_window_extent()


def check_within(figure, *boxes):
    """Fail unless boxes lie in a figure."""
    for box in boxes:
        assert -1 <= box.x0 < box.x1 <= figure.bbox.width + 1
        assert -1 <= box.y0 < box.y1 <= figure.bbox.height + 1


def class_of(space, states, occupied):
    """Return the legend entry of a cell with these states."""
    best = min(states)
    if occupied:
        return "obstacle, free for the reference point" if best == FREE else "obstacle"
    return "free at some rotations" if best == FREE and len(states) > 1 else CLASS_NAMES[best]


def check_cells(
    space,
    ax,
    image,
    cells,
    rotations,
):
    """Check the colours of cells; return their legend entries."""
    seen = set()
    for cell in cells:
        x, y = space.grid.center_of(cell)
        states = {int(space.classify((x, y, *rotation))) for rotation in rotations}
        name = class_of(space, states, bool(space.workspace.outer[tuple(cell)]))
        assert pixel(ax, image, x, y) == COLORS[name]
        seen.add(name)
    return seen
