"""All of OMPL's planners on one map, side by side: ``python examples/compare_planners.py [FOLDER]``."""

import sys
from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

import cspace
import planners

START, GOAL = (0.7, 0.7), (9.3, 5.3)


def build_map() -> cspace.CSpace:
    """The map of a cart of 0.5 m by 0.3 m in a room of 10 m by 6 m with two walls and some pillars."""
    occupied = np.zeros((200, 120), dtype=bool)  # [x, y], 0.05 m each
    occupied[60:66, :90] = True
    occupied[130:136, 40:] = True
    for x in (20, 85, 110, 155):
        for y in (35, 65, 95):
            occupied[x : x + 6, y : y + 6] = True
    return cspace.build(cspace.Workspace.from_array(occupied, 0.05), cspace.Robot.rectangle(0.5, 0.3))


def draw(space: cspace.CSpace, plans: list[planners.Plan], file: Path) -> None:
    """One small picture of the map and the path for each planner."""
    figure = Figure(figsize=(15, 7), layout="constrained")  # belongs to no window
    axes = figure.subplots(-(-len(plans) // 5), 5, sharex=True, sharey=True)
    extent = [space.grid.lower[0], space.grid.upper[0], space.grid.lower[1], space.grid.upper[1]]
    shades = ListedColormap(["white", "0.75", "0.35"])
    for ax in axes.flat[len(plans) :]:
        ax.set_visible(False)
    for ax, plan in zip(axes.flat, plans, strict=False):
        ax.imshow(space.state.T, origin="lower", extent=extent, cmap=shades, vmin=0, vmax=2)
        ax.plot(*plan.path.T, color="#0072b2", linewidth=2)
        ax.plot(*START, "o", color="#009e73")
        ax.plot(*GOAL, "*", color="#d55e00", markersize=10)
        ax.set_title(f"{plan.planner}: {plan.length:.2f} m, {1e3 * plan.times.planning:.1f} ms", fontsize=10)
    figure.supxlabel("x (m); white: free, light grey: undecided, dark grey: in collision")
    figure.supylabel("y (m)")
    figure.savefig(file, dpi=100)


def main(arguments: list[str]) -> None:
    folder = Path(arguments[0]) if arguments else Path(__file__).parent / "output"
    folder.mkdir(parents=True, exist_ok=True)
    space = build_map()
    planners.plan(space, START, GOAL)  # the first plan compiles; that is not the planners' time
    plans = [planners.plan(space, START, GOAL, planner=name, time_limit=0.3) for name in planners.planner_names()]
    print(f"{'planner':16} {'length':>8} {'clearance':>10} {'planning':>11}")
    for plan in sorted(plans, key=lambda plan: plan.length):
        print(
            f"{plan.planner:16} {plan.length:6.2f} m {plan.clearance:8.3f} m {1e3 * plan.times.planning:8.1f} ms  "
            + ("certified" if plan.certified else plan.status)
        )
    draw(space, plans, folder / "compare_planners.png")
    print(f"picture: {folder / 'compare_planners.png'}")


if __name__ == "__main__":
    main(sys.argv[1:])
