"""Can a part be drawn out of its housing? ``python examples/drawn_out.py [--output FOLDER]``.

A key with a wide head sits in a T-shaped slot. It cannot be lifted out; it can be slid out, unless the slot's end is
capped. Whether it comes out is a question of connectivity: the map answers it with a proof, and no planner is run.
"""

import argparse
from pathlib import Path

import trimesh

import cspace
from cspace.plot import save_plot

SPACING = 0.0005
SEATED, OUTSIDE = (0.0, 0.0, 0.0), (0.0, 0.0, 0.045)  # metres; the second is above the housing


def solid(*corners: tuple[tuple[float, ...], tuple[float, ...]]) -> trimesh.Trimesh:
    """A union of boxes, each from a lower to an upper corner, in millimetres; they may touch and overlap."""
    return trimesh.util.concatenate(
        [trimesh.creation.box(bounds=[[c / 1000 for c in low], [c / 1000 for c in high]]) for low, high in corners]
    )


def key() -> trimesh.Trimesh:
    """A key: a head of 20 x 24 x 6 mm, and on it a stem of 10 mm."""
    return solid(((-10, -12, 0), (10, 12, 6)), ((-10, -5, 5), (10, 5, 20)))


def housing(capped: bool) -> trimesh.Trimesh:
    """A block with a T-shaped slot along x, shut at one end, and at both where it is capped."""
    parts = [
        ((-30, -24, -10), (30, 24, -2)),  # floor
        ((-30, -24, -4), (30, -14, 14)),  # walls
        ((-30, 14, -4), (30, 24, 14)),
        ((-30, -16, 9), (30, -7, 14)),  # lips over the head
        ((-30, 7, 9), (30, 16, 14)),
        ((-30, -24, -4), (-22, 24, 14)),  # end
    ]
    return solid(*parts, *([((22, -24, -4), (30, 24, 14))] if capped else []))


def main() -> None:
    parser = argparse.ArgumentParser(description="Can a part be drawn out of its housing?")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    part = cspace.Robot.mesh(key(), name="key")
    for capped in (False, True):
        name = "capped" if capped else "open"
        workspace = cspace.Workspace.from_mesh(housing(capped), SPACING, (-0.06, -0.05, -0.03, 0.08, 0.05, 0.06))
        space = cspace.build(workspace, part, outside="free")
        answer = {True: "comes out", False: "cannot come out: proven", None: "undecided at this spacing"}
        lifted = space.motion_is_free(SEATED, OUTSIDE)
        print(f"slot {name}: the key {answer[space.path_exists(SEATED, OUTSIDE)]}; straight up: {lifted}")
        print(f"  room of the seated key: {1000 * space.clearance(SEATED):.1f} mm in every direction")
        picture = save_plot(
            space, options.output / f"drawn_out_{name}.png", True, start=SEATED, goal=OUTSIDE, at=SEATED
        )
        print(f"  {picture}: {picture.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
