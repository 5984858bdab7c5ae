"""Draw the pictures of the pages: ``python docs/pictures/draw.py`` rewrites the PNG files beside
it.

All except the hull tree show answers of maps that the library builds here.
"""

from __future__ import annotations

import contextlib
import itertools
import re
import runpy
import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from numpy.typing import ArrayLike, NDArray
from shapely import affinity

import cspace
import cspace.arms
import planners
from cspace._cli.demo import GOAL_POSITION, START_POSITION, demo_workspace, write_inputs
from cspace.plot import animate

FREE, MIXED, BLOCKED = "#ffffff", "#d55e00", "#a6d3ee"
OBSTACLE, ROBOT, PATH, PALE = "#262626", "#009e73", "#6a1b9a", "#c3e6da"
GRID = "#bbbbbb"
DPI = 120
ARC_RADIUS = 0.7
"""Radius in metres of the arc that shows the parts of a motion."""
STATES = ListedColormap([FREE, MIXED, BLOCKED])


def draw_all(folder: Path) -> None:
    """Write every picture into a folder, as PNG, and the films as GIF."""
    style = {"font.size": 9.0, "figure.facecolor": "white", "axes.titlesize": 10.0}
    with matplotlib.rc_context(style):
        for draw in (
            draw_correlation,
            draw_states,
            draw_covering_angle,
            draw_convergence,
            draw_window,
            draw_hull_tree,
            draw_arm,
            draw_clean_drawing,
            draw_joint_map,
            draw_reachability,
            draw_spheres,
            draw_trajectory,
            draw_controller,
            draw_speed_limits,
            draw_floor,
            draw_regions,
        ):
            figure = draw()
            name = draw.__name__.removeprefix("draw_")
            figure.savefig(folder / f"{name}.png", dpi=DPI, bbox_inches="tight")
            plt.close(figure)
    space, plan = plan_around_wall()
    animate(space, drive_around_wall(plan), folder / "controller.gif", overwrite=True, title="")
    space, trajectory = drive_through_flat()
    animate(space, trajectory, folder / "flat.gif", overwrite=True, title="", seconds=10.0)
    example = Path(__file__).parents[2] / "examples" / "wait_for_others.py"
    with contextlib.chdir(folder):
        runpy.run_path(str(example))


# ---- first contact -------------------------------------------------------------------------------


def drive_through_flat() -> tuple[cspace.CSpace, planners.Trajectory]:
    """Drive from room to room in the floor plan of the demo."""
    outline = cspace.Robot.rectangle(0.7, 0.5)
    space = cspace.build(demo_workspace(0.05), outline, rotations=72)
    start, goal = (*START_POSITION, 0.0), (*GOAL_POSITION, 0.0)
    plan = planners.plan(space, start, goal, drive=planners.Differential(), seed=1)
    return space, plan.trajectory(
        max_velocity=1.5,
        max_acceleration=1.0,
        max_angular_velocity=2.0,
        max_angular_acceleration=3.0,
    )


def draw_arm() -> Figure:
    """Draw the arm of the demo on its way around a board."""
    pose = np.eye(4)
    pose[:3, 3] = 0.6, 0.0, 0.3
    board = cspace.arms.PosedShape(cspace.Robot.box((0.4, 0.1, 0.6)).shape, pose)
    with tempfile.TemporaryDirectory() as folder:
        arm = cspace.Arm.from_urdf(write_inputs(Path(folder))["arm"])
    space = cspace.build_arm_space({"board": board}, arm)
    plan = planners.plan(space, (-0.8, 0.9, 0.8), (0.8, 0.9, 0.8), seed=1)
    figure: Figure = space.plot(path=plan, title="", camera=(30, -40)).figure
    return figure


def draw_clean_drawing() -> Figure:
    """Draw what the page "Clean a drawing" makes: the drawing, the walls in it, and a path."""
    page = Path(__file__).parents[1] / "howto" / "clean_drawing.md"
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        exec("".join(blocks), names)
    figure, axes = plt.subplots(1, 3, figsize=(9.6, 2.4), layout="constrained")
    cleaned = np.where(names["removed"], 2, names["walls"])
    drawings = (("dark pixels", names["dark"]), ("orange: removed", cleaned))
    colors = ListedColormap([FREE, OBSTACLE, MIXED])
    for ax, (title, pixels) in zip(axes, drawings, strict=False):
        ax.imshow(pixels.T, origin="lower", extent=(0, 8, 0, 5), cmap=colors, vmin=0, vmax=2)
        ax.set(title=title, xlabel="x (m)")
    names["space"].plot(ax=axes[2], path=names["plan"].path, legend=False, title="a certified path")
    return figure


# ---- concepts ------------------------------------------------------------------------------------


def draw_correlation() -> Figure:
    """Draw obstacle cells W, robot offsets A, and the number of coincidences for each cell of the
    map."""
    occupied = np.zeros((11, 8), dtype=bool)
    occupied[3:5, :4] = True
    occupied[7:9, 5:] = True
    offsets = [(0, 0), (1, 0), (0, 1), (-1, 0)]
    counts = np.zeros(occupied.shape, dtype=int)
    for k in np.ndindex(occupied.shape):
        for m in offsets:
            i = (k[0] + m[0], k[1] + m[1])
            counts[k] += 0 <= i[0] < 11 and 0 <= i[1] < 8 and occupied[i]
    figure, axes = plt.subplots(
        1, 3, figsize=(9.6, 2.9), width_ratios=[11, 5, 11], layout="constrained"
    )
    axes[0].set_title("W: cells that meet an obstacle")
    fill_cells(axes[0], occupied, ListedColormap([FREE, OBSTACLE]))
    raster = np.zeros((5, 5), dtype=bool)
    for m in offsets:
        raster[m[0] + 2, m[1] + 2] = True
    axes[1].set_title("A: offsets of the robot")
    fill_cells(axes[1], raster, ListedColormap([FREE, ROBOT]))
    axes[1].plot(2.5, 2.5, "o", color="white", markersize=5.0)
    axes[1].text(2.5, -0.6, "dot: reference point", ha="center", fontsize=8.0)
    axes[2].set_title("W * A: coincidences for each position")
    fill_cells(axes[2], counts > 0, ListedColormap([FREE, BLOCKED]))
    for k in np.ndindex(counts.shape):
        color, weight = ("#999999", "normal") if counts[k] == 0 else ("black", "bold")
        axes[2].text(
            k[0] + 0.5,
            k[1] + 0.5,
            counts[k],
            ha="center",
            va="center",
            fontsize=7.5,
            color=color,
            weight=weight,
        )
    return figure


def draw_states() -> Figure:
    """Draw the states around an obstacle at two spacings, with the exact border of the C-obstacle."""
    obstacle = shapely.Polygon([(1.6, 1.1), (3.3, 1.4), (2.9, 2.6), (1.9, 2.3)])
    robot = shapely.box(-0.45, -0.3, 0.45, 0.3)
    # The Minkowski sum of convex polygons is the hull of the sums of their corners.
    corners = shapely.get_coordinates(obstacle)[:, None] - shapely.get_coordinates(robot)
    exact = shapely.convex_hull(shapely.MultiPoint(corners.reshape(-1, 2)))
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.0), layout="constrained")
    for ax, spacing in zip(axes, (0.2, 0.1), strict=True):
        workspace = cspace.Workspace.from_polygons(
            [obstacle], spacing=spacing, bounds=(0.6, 0.4, 4.4, 3.4)
        )
        space = cspace.build(workspace, robot, outside="free")
        states = space.classify(centers(workspace.grid))
        draw_states_in(ax, states, (0.6, 4.4, 0.4, 3.4), spacing)
        ax.add_patch(
            polygon(
                exact, edgecolor="black", facecolor="none", linewidth=1.2, linestyle="--", zorder=3
            )
        )
        ax.add_patch(polygon(obstacle, facecolor=OBSTACLE, zorder=3))
        ax.add_patch(
            polygon(
                affinity.translate(robot, 1.22, 2.75),
                facecolor="none",
                edgecolor=ROBOT,
                linewidth=2.0,
                zorder=4,
            )
        )
        ax.plot(1.22, 2.75, "o", color=ROBOT, markersize=4.0, zorder=5)
        ax.set_title(f"cells of {spacing} m")
    handles = [
        Patch(facecolor=FREE, edgecolor=GRID, label="FREE"),
        Patch(facecolor=MIXED, label="MIXED"),
        Patch(facecolor=BLOCKED, label="BLOCKED"),
        Patch(facecolor=OBSTACLE, label="obstacle"),
        Patch(facecolor="none", edgecolor=ROBOT, linewidth=2.0, label="robot at one position"),
        plt.Line2D([], [], color="black", linestyle="--", label="exact border of the C-obstacle"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False, fontsize=8.5)
    return figure


def draw_covering_angle() -> Figure:
    """Draw a rectangle at the rotations of one yaw cell, and the sets that contain and lie in all
    of them."""
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.5), layout="constrained")
    robot = shapely.box(-0.5, -0.28, 1.3, 0.28)
    for ax, count, cell in ((axes[0], 12, 1), (axes[1], 36, 3)):
        rotations = cspace.Rotations.of(count)
        angle, center = (
            float(rotations.covering_angles[cell]),
            float(np.ravel(rotations.centers)[cell]),
        )
        at = [
            affinity.rotate(robot, center + t, origin=(0, 0), use_radians=True)
            for t in np.linspace(-angle, angle, 61)
        ]
        outer, inner = shapely.union_all(at), shapely.intersection_all(at)
        ax.add_patch(polygon(outer, facecolor="#fbd9bf", edgecolor=MIXED, linewidth=1.5))
        ax.add_patch(polygon(inner, facecolor="#d4eaf7", edgecolor="#4a90c0", linewidth=1.5))
        for shape in (at[0], at[-1]):
            ax.add_patch(
                polygon(shape, facecolor="none", edgecolor="#777777", linewidth=0.8, linestyle=":")
            )
        ax.add_patch(polygon(at[30], facecolor="none", edgecolor=ROBOT, linewidth=2.0))
        ax.plot(0, 0, "o", color="black", markersize=4.0)
        tip = np.array([1.3, 0.28])
        reach = 2.0 * np.hypot(*tip) * np.sin(angle / 2.0)
        ax.set_title(
            f"rotations={count}: covering angle {np.degrees(angle):.0f}°, the tip moves by {reach:.2f} m"
        )
        ax.set(xlim=(-0.95, 1.65), ylim=(-0.75, 1.2), aspect="equal")
        ax.axis("off")
    handles = [
        Patch(
            facecolor="none", edgecolor=ROBOT, linewidth=2.0, label="robot at the representative"
        ),
        plt.Line2D([], [], color="#777777", linestyle=":", label="at both ends of the cell"),
        Patch(
            facecolor="#fbd9bf",
            edgecolor=MIXED,
            label="at some rotation of the cell: lies in A_out",
        ),
        Patch(
            facecolor="#d4eaf7",
            edgecolor="#4a90c0",
            label="at every rotation of the cell: holds A_in",
        ),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8.5)
    return figure


def draw_convergence() -> Figure:
    """Draw the share of MIXED cells as cells and rotations get smaller, together and apart."""
    block = shapely.Polygon([(1.0, 1.2), (2.6, 0.9), (3.0, 2.4), (1.7, 3.1)])
    post = shapely.box(3.9, 2.8, 4.6, 4.0)
    solid = cspace.Robot.box((0.6, 0.7, 0.5), (1.05, 0.95, 1.0))
    box = cspace.Robot.box((0.5, 0.3, 0.2))

    def build_plane(spacing: float, yaws: int) -> cspace.CSpace:
        bounds = (0.0, 0.0, 5.6, 4.8)
        workspace = cspace.Workspace.from_polygons([block, post], spacing=spacing, bounds=bounds)
        robot = cspace.Robot.rectangle(0.9, 0.6)
        return cspace.build(workspace, robot, rotations=yaws, outside="free")

    def build_solid(spacing: float, parts: int) -> cspace.CSpace:
        workspace = cspace.Workspace.from_shapes([solid], spacing, bounds=(0, 0, 0, 2, 2, 2))
        rotations = cspace.Rotations.quaternions(parts)
        return cspace.build(workspace, box, rotations=rotations, outside="free")

    cases: list[tuple[str, Any, list[float], list[int], str]] = [
        ("SE(2): a rectangle", build_plane, [0.2, 0.1, 0.05, 0.025], [18, 36, 72, 144], "{} yaws"),
        ("SE(3): a box", build_solid, [0.2, 0.1, 0.05], [4, 8, 16], "n = {}"),
    ]
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained")
    for ax, (title, make, spacings, counts, label) in zip(axes, cases, strict=True):
        steps = range(len(spacings))
        for name, color, at in (
            ("cells and rotations", PATH, [(k, k) for k in steps]),
            (f"cells, {label.format(counts[0])}", MIXED, [(k, 0) for k in steps]),
            (f"rotations, cells of {spacings[0]} m", ROBOT, [(0, k) for k in steps]),
        ):
            counted = [make(spacings[i], counts[j]).count() for i, j in at]
            shares = [mixed / (free + mixed + blocked) for free, mixed, blocked in counted]
            numbers = ", ".join(f"{share:.3f}" for share in shares)
            ax.semilogy(steps, shares, "o-", color=color, label=f"{name}: {numbers}")
        ticks = [
            f"{spacing:g} m\n{label.format(count)}"
            for spacing, count in zip(spacings, counts, strict=True)
        ]
        ax.set_xticks(steps, ticks)
        ax.set_yticks([0.05, 0.1, 0.2, 0.4], ["0.05", "0.1", "0.2", "0.4"], minor=False)
        ax.set_yticks([], minor=True)
        ax.set(title=title, ylabel="share of MIXED cells", ylim=(0.028, 0.9))
        ax.grid(color=GRID, linewidth=0.4)
        ax.legend(
            title="refined:", alignment="left", fontsize=7.5, framealpha=1.0, loc="lower left"
        )
    return figure


def draw_window() -> Figure:
    """Draw a map in tiles, and a window of it."""
    rng = np.random.default_rng(4)
    occupied = np.zeros((256, 192), dtype=bool)
    for x, y in np.ndindex(8, 6):
        w, h = rng.integers(12, 23, 2)
        occupied[32 * x + 5 : 32 * x + 5 + w, 32 * y + 5 : 32 * y + 5 + h] = True
    lower, upper = (40.0, 25.0), (85.0, 66.0)
    with tempfile.TemporaryDirectory() as folder:
        workspace = cspace.Workspace.from_array(occupied, 0.5)
        space = cspace.build(
            workspace, cspace.Robot.disc(1.2), store=Path(folder) / "city.zarr", tile=64
        )
        whole = space.classify(centers(workspace.grid))
        window = space.window(lower, upper)
        part = window.classify(centers(window.grid))
        start, end = window.grid.lower, window.grid.upper
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.9), width_ratios=[5, 4], layout="constrained")
    axes[0].set_title("a tiled map: 4 x 3 tiles")
    axes[1].set_title("space.window(lower, upper), in memory")
    for ax, states, extent in (
        (axes[0], whole, (0.0, 128.0, 0.0, 96.0)),
        (axes[1], part, (start[0], end[0], start[1], end[1])),
    ):
        draw_states_in(ax, states, extent, None)
    for x in range(0, 129, 32):
        axes[0].plot([x, x], [0, 96], color="black", linewidth=1.0)
    for y in range(0, 97, 32):
        axes[0].plot([0, 128], [y, y], color="black", linewidth=1.0)
    axes[0].text(2, 90, "tile", fontsize=9.0, weight="bold", backgroundcolor="white")
    for ax in axes:
        size = (upper[0] - lower[0], upper[1] - lower[1])
        ax.add_patch(Rectangle(lower, *size, fill=False, edgecolor=PATH, linewidth=2.2))
    axes[1].set_facecolor("#f6c9a8")
    axes[1].set(xlim=(start[0] - 5, end[0] + 5), ylim=(start[1] - 5, end[1] + 5))
    axes[1].text(start[0] - 4.2, start[1] - 3.9, "outside: unknown, so MIXED", fontsize=8.5)
    handles = [
        Patch(facecolor=FREE, edgecolor=GRID, label="FREE"),
        Patch(facecolor=MIXED, label="MIXED"),
        Patch(facecolor=BLOCKED, label="BLOCKED"),
        Patch(facecolor="none", edgecolor=PATH, linewidth=2.2, label="the box that was asked for"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8.5)
    return figure


def draw_trajectory() -> Figure:
    """Draw the paths of a differential drive and of a car around a wall, and their speed over time."""
    occupied = np.zeros((160, 100), dtype=bool)
    occupied[78:82, :70] = True
    space = cspace.build(
        cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.rectangle(0.9, 0.6), rotations=36
    )
    limits: dict[str, Any] = {
        "max_velocity": 1.0,
        "max_acceleration": 0.5,
        "max_angular_velocity": 1.0,
    }
    figure, axes = plt.subplots(2, 2, figsize=(9.6, 4.9), width_ratios=[2, 5], layout="constrained")
    drives: list[tuple[planners.Car | planners.Differential, dict[str, float]]] = [
        (planners.Differential(), {"max_angular_acceleration": 1.0}),
        (planners.Car(turning_radius=1.2, reverse=True), {}),
    ]
    for (left, right), (drive, further) in zip(axes, drives, strict=True):
        start, goal = (2.0, 2.0, 0.0), (14.0, 2.0, 0.0)
        plan = planners.plan(space, start, goal, drive=drive, time_limit=5.0, seed=1)
        trajectory = plan.trajectory(**limits, **further)
        left.imshow(
            occupied.T, origin="lower", extent=(0, 16, 0, 10), cmap=ListedColormap([FREE, OBSTACLE])
        )
        left.plot(*trajectory.positions[:, :2].T, color=PATH, linewidth=1.8)
        rests = trajectory.positions[~trajectory.velocities.any(axis=1)]
        left.plot(*rests[:, :2].T, ".", color=PATH, markersize=8.0)
        left.set(title=f"{type(drive).__name__}; dots: stops", xlabel="x (m)", ylabel="y (m)")
        trajectory.plot(right)
        right.set_title(f"{trajectory.duration:.1f} s; blue: speed, orange: angular speed")
    return figure


def plan_around_wall() -> tuple[cspace.CSpace, planners.Plan]:
    """Plan a path of a differential drive around a wall."""
    occupied = np.zeros((160, 100), dtype=bool)
    occupied[50:54, :65] = True
    outline = cspace.Robot.rectangle(0.9, 0.6)
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), outline, rotations=72)
    plan = planners.plan(
        space, (2.0, 2.0, 0.0), (14.0, 8.0, 0.0), drive=planners.Differential(), seed=1
    )
    return space, plan


def drive_around_wall(plan: planners.Plan) -> planners.Trajectory:
    """Make the trajectory of a path of a differential drive."""
    return plan.trajectory(
        max_velocity=1.0,
        max_acceleration=0.5,
        max_angular_velocity=1.0,
        max_angular_acceleration=1.5,
    )


def draw_controller() -> Figure:
    """Draw the curve of a differential drive around a wall, and its commands over time."""
    _, plan = plan_around_wall()
    trajectory = drive_around_wall(plan)
    commands = trajectory.sample_uniform(20.0)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.2), layout="constrained")
    wall = Rectangle((5.0, 0.0), 0.4, 6.5, facecolor=OBSTACLE)
    left.add_patch(wall)
    left.set(xlim=(0.0, 16.0), ylim=(0.0, 10.0), aspect="equal")
    footprint = shapely.box(-0.45, -0.3, 0.45, 0.3)
    for x, y, yaw in commands.positions[::20].tolist():
        turned = affinity.rotate(footprint, yaw, origin=(0.0, 0.0), use_radians=True)
        placed = affinity.translate(turned, x, y)
        left.add_patch(polygon(placed, facecolor=PALE, edgecolor=ROBOT, linewidth=0.8))
    left.plot(*plan.waypoints[:, :2].T, "--", color=MIXED, linewidth=1.0, label="path")
    left.plot(*commands.positions[:, :2].T, color=PATH, linewidth=1.8, label="trajectory")
    left.set(xlabel="x (m)", ylabel="y (m)", title="once a second")
    left.legend(frameon=False, loc="lower right")
    right.plot(commands.times, commands.v, color=PATH, label="v (m/s)")
    right.plot(commands.times, commands.omega, color=ROBOT, label="omega (rad/s)")
    right.set(xlabel="time (s)", title=f"{trajectory.duration:.1f} s, no stop on the way")
    right.legend(frameon=False)
    return figure


def draw_speed_limits() -> Figure:
    """Draw a path that is coloured by speed: in a zone, and near a wall."""
    walls = [shapely.box(0, 0, 16, 0.2), shapely.box(7, 0, 7.4, 6.5)]
    hall = cspace.Workspace.from_polygons(walls, spacing=0.1, bounds=(0, 0, 16, 10))
    space = cspace.build(hall, cspace.Robot.rectangle(0.9, 0.6), rotations=72)
    drive = planners.Differential()
    plan = planners.plan(space, (2.0, 2.0, 0.0), (14.0, 3.0, 0.0), drive=drive)
    area = shapely.box(9.0, 4.0, 12.0, 9.0)
    trajectory = plan.trajectory(
        max_velocity=1.5,
        max_acceleration=0.5,
        max_angular_velocity=1.0,
        max_angular_acceleration=1.5,
        speed=[planners.SpeedZones([(area, 0.4)]), planners.SlowNear(space, 0.8, 0.5)],
    )
    rows = trajectory.sample_uniform(50.0)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.2), layout="constrained")
    for wall in walls:
        left.add_patch(polygon(wall, facecolor=OBSTACLE))
    left.add_patch(polygon(area, facecolor=MIXED, alpha=0.2))
    footprint = shapely.box(-0.45, -0.3, 0.45, 0.3)
    for x, y, yaw in rows.positions[::75].tolist():
        turned = affinity.rotate(footprint, yaw, origin=(0.0, 0.0), use_radians=True)
        left.add_patch(polygon(affinity.translate(turned, x, y), facecolor="none", edgecolor=GRID))
    left.set(xlim=(0.0, 16.0), ylim=(0.0, 10.0), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    speeds = np.abs(rows.v)
    dots = left.scatter(*rows.positions[:, :2].T, c=speeds, s=5, cmap="viridis", zorder=3)
    figure.colorbar(dots, ax=left, label="speed (m/s)")
    right.plot(rows.times, speeds, color=PATH)
    right.axhline(0.4, color=MIXED, linestyle="--", label="in the zone")
    right.axhline(0.8, color=OBSTACLE, linestyle=":", label="near a wall")
    right.set(xlabel="time (s)", ylabel="speed (m/s)", title=f"{trajectory.duration:.1f} s")
    right.legend(frameon=False)
    return figure


def draw_floor() -> Figure:
    """Draw a hall with a beam: the map of a robot's heights beside that of its projection."""
    cells = np.zeros((80, 60, 24), dtype=bool)
    cells[38:42, :, 15:] = True
    cells[20:24, :36] = True
    scene = cspace.Workspace.from_array(cells, 0.05)
    robot = cspace.Robot.box((0.7, 0.5, 0.7), (0.0, 0.0, 0.36))
    space = cspace.build(scene, robot, rotations=72, floor=0.0)
    ground = cspace.Workspace.from_array(cells.any(axis=2), 0.05)
    flat = cspace.build(ground, robot.footprint(), rotations=72)
    plan = planners.plan(
        space, (0.52, 0.62, 0.0), (3.32, 0.62, 0.0), drive=planners.Differential(), seed=1
    )
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained")
    space.plot(ax=left, path=plan.path, title="floor=0.0: under the beam", legend=False)
    flat.plot(ax=right, title="projected: the beam is a wall", legend=False)
    return figure


def draw_regions() -> Figure:
    """Draw the regions that cover a depot, and the corridor along a path there."""
    racks = [shapely.box(x, 1.5, x + 1.2, 10.5) for x in (3, 7, 11)]
    depot = cspace.Workspace.from_polygons(racks, spacing=0.1, bounds=(0, 0, 16, 14))
    space = cspace.build(depot, cspace.Robot.rectangle(0.7, 0.5))
    plan = planners.plan(space, (1.0, 1.0), (15.0, 13.0))
    cover = space.free_regions(0.95, reach=8.0)
    corridor = plan.corridor()
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.3), layout="constrained")
    covered = f"{cover.coverage:.0%} of the FREE cells in {len(cover.regions)} regions"
    followed = f"a corridor of {len(corridor.regions)} regions"
    for ax, regions, title in zip(axes, (cover, corridor), (covered, followed), strict=True):
        path = plan if regions is corridor else None
        space.plot(ax=ax, path=path, legend=False, title=title)
        regions.plot(ax, linewidth=0.8)
    return figure


def draw_hull_tree() -> Figure:
    """Draw the levels of a hull tree, and the parts into which a motion past an obstacle is halved."""
    joint = (0.0, 0.0)
    parts = [
        shapely.Polygon([(-0.15, -0.15), (0.9, -0.12), (0.9, 0.12), (-0.15, 0.15)]),
        shapely.Polygon([(0.85, -0.12), (1.55, -0.1), (1.55, 0.1), (0.85, 0.12)]),
        shapely.Polygon([(1.4, -0.1), (1.6, -0.1), (1.62, 0.5), (1.42, 0.5)]),
        shapely.Polygon([(1.42, 0.45), (1.9, 0.42), (1.9, 0.58), (1.42, 0.6)]),
    ]
    link = shapely.union_all(parts)
    obstacle = shapely.Polygon([(1.2, 1.69), (1.75, 1.6), (1.8, 2.1), (1.1, 2.2)])
    levels = [[parts], [parts[:2], parts[2:]], [[part] for part in parts]]
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.9), width_ratios=[3, 4], layout="constrained")
    axes[0].set_title("a hull tree: each level lies closer around the link")
    for row, groups in enumerate(levels):
        for group in groups:
            hull = affinity.translate(shapely.union_all(group).convex_hull, 0.0, -1.05 * row)
            axes[0].add_patch(polygon(hull, facecolor="#fdebdd", edgecolor=MIXED, linewidth=1.5))
        axes[0].add_patch(
            polygon(affinity.translate(link, 0.0, -1.05 * row), facecolor=ROBOT, alpha=0.85)
        )
        axes[0].text(
            -0.3, 0.15 - 1.05 * row, ("1 hull", "2 hulls", "4 hulls")[row], ha="right", va="center"
        )
    axes[0].set(xlim=(-1.1, 2.1), ylim=(-2.4, 0.8), aspect="equal")
    pieces = halve_motion(link, obstacle, joint, np.radians(-55.0), np.radians(82.0))
    axes[1].set_title(f"a motion of 137°, proven free in {len(pieces)} parts")
    colors = plt.get_cmap("viridis")(np.linspace(0.1, 0.9, len(pieces)))
    for (first, last), color in zip(pieces, colors, strict=True):
        for t in (first, last):
            placed = affinity.rotate(link, t, origin=joint, use_radians=True)
            axes[1].add_patch(polygon(placed, facecolor="none", edgecolor="#999999", linewidth=0.6))
        arc = np.linspace(first, last, 20)
        axes[1].plot(
            ARC_RADIUS * np.cos(arc),
            ARC_RADIUS * np.sin(arc),
            color=color,
            linewidth=5.0,
            solid_capstyle="butt",
        )
    for t in {t for piece in pieces for t in piece}:
        tick = np.array([ARC_RADIUS - 0.07, ARC_RADIUS + 0.07])
        axes[1].plot(tick * np.cos(t), tick * np.sin(t), color="black", linewidth=0.8)
    axes[1].add_patch(
        polygon(
            affinity.rotate(link, pieces[0][0], origin=joint, use_radians=True), facecolor=ROBOT
        )
    )
    axes[1].add_patch(polygon(obstacle, facecolor=OBSTACLE))
    axes[1].plot(*joint, "o", color="black", markersize=5.0)
    axes[1].text(0.75, -0.45, "far: long parts", ha="left")
    axes[1].text(1.95, 1.45, "near: short parts", ha="left")
    axes[1].set(xlim=(-0.7, 3.2), ylim=(-1.5, 2.3), aspect="equal")
    for ax in axes:
        ax.axis("off")
    return figure


def halve_motion(
    link: shapely.Geometry,
    obstacle: shapely.Geometry,
    joint: tuple[float, float],
    first: float,
    last: float,
) -> list[tuple[float, float]]:
    """Halve a turn of a link until in each part the link cannot reach the obstacle from the middle
    of the part."""
    middle, half = (first + last) / 2.0, (last - first) / 2.0
    placed = affinity.rotate(link, middle, origin=joint, use_radians=True)
    reach = max(np.hypot(x - joint[0], y - joint[1]) for x, y in shapely.get_coordinates(link))
    if placed.distance(obstacle) > half * reach:
        return [(first, last)]
    halves = (first, middle), (middle, last)
    return [piece for part in halves for piece in halve_motion(link, obstacle, joint, *part)]


# ---- tasks ---------------------------------------------------------------------------------------


def read_two_bars() -> cspace.Arm:
    """Read an arm of two bars, each 1 m long, in the plane."""
    bar = (
        '<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>'
    )
    joint = (
        '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "two.urdf"
        file.write_text(
            f'<robot name="two"><link name="base"/><link name="upper">{bar}</link><link name="fore">{bar}</link>'
            + joint.format("shoulder", "base", "upper", 0)
            + joint.format("elbow", "upper", "fore", 1)
            + "</robot>"
        )
        return cspace.Arm.from_urdf(file)


def draw_reachability() -> Figure:
    """Draw which positions the tip of two bars beside a post can reach."""
    arm = read_two_bars()
    post = np.eye(4)
    post[:2, 3] = 1.5, 1.0
    round_post = cspace.arms.PosedShape(cspace.Robot.cylinder(0.1, 1.0).shape, post)
    space = cspace.build_arm_space({"post": round_post}, arm)
    tip = np.eye(4)
    tip[0, 3] = 1.0
    longer = arm.attach("tip", cspace.Robot.ball(0.01).shape, "fore", tip)
    along = np.linspace(-2.2, 2.2, 45)
    x, y = np.meshgrid(along, along)
    poses = np.tile(np.eye(4), (x.size, 1, 1))
    poses[:, :2, 3] = np.stack([x.ravel(), y.ravel()], axis=1)
    q = longer.inverse("tip", poses, tolerance=(0.01, np.inf), max_solutions=1)
    reached = ~np.isnan(q).any(axis=1)
    free = reached.copy()
    free[reached] = space.is_free(q[reached])
    figure, ax = plt.subplots(figsize=(4.6, 4.6), layout="constrained")
    kinds = (
        ("a free configuration", free, ROBOT),
        ("one that touches the post", reached & ~free, MIXED),
        ("none found", ~reached, GRID),
    )
    for label, mask, color in kinds:
        ax.scatter(x.ravel()[mask], y.ravel()[mask], s=14.0, color=color, label=label)
    ax.add_patch(plt.Circle((1.5, 1.0), 0.1, color=OBSTACLE))
    ax.plot([0.0, 1.0, 1.0 + np.cos(0.7)], [0.0, 0.0, np.sin(0.7)], color=PATH, linewidth=4.0)
    ax.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title="positions of the tip")
    figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize=8.5)
    return figure


def draw_joint_map() -> Figure:
    """Draw an arm of two bars among two posts along a path, and the same path in the map of its
    joints."""
    arm = read_two_bars()
    posts, obstacles = [(1.5, 1.0), (-0.4, 1.2)], {}
    for k, post in enumerate(posts):
        pose = np.eye(4)
        pose[:2, 3] = post
        obstacles[f"post {k}"] = cspace.arms.PosedShape(
            cspace.Robot.cylinder(0.15, 1.0).shape, pose
        )
    joints = cspace.build_joint_map(cspace.build_arm_space(obstacles, arm), 0.03)
    path = planners.plan(joints, (-0.6, 0.3), (1.4, -0.2)).waypoints
    states = joints.classify(centers(joints.grid))
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.2), layout="constrained")
    for x, y in posts:
        axes[0].add_patch(plt.Circle((x, y), 0.15, color=OBSTACLE))
    steps = np.concatenate([np.linspace(a, b, 9) for a, b in itertools.pairwise(path)])
    for k, (shoulder, elbow) in enumerate(steps):
        mid = np.array([np.cos(shoulder), np.sin(shoulder)])
        tip = mid + np.array([np.cos(shoulder + elbow), np.sin(shoulder + elbow)])
        first_or_last = k in (0, len(steps) - 1)
        axes[0].plot(
            *np.array([(0.0, 0.0), mid, tip]).T,
            color=ROBOT if first_or_last else PALE,
            linewidth=5.0,
            zorder=2 if first_or_last else 1,
            solid_capstyle="round",
        )
    axes[0].plot(0, 0, "o", color="black", markersize=6.0)
    axes[0].set_title("the arm along its path")
    axes[0].set(xlim=(-1.3, 2.3), ylim=(-1.5, 2.3), aspect="equal", xlabel="x (m)", ylabel="y (m)")
    lower, upper = joints.grid.lower, joints.grid.upper
    draw_states_in(axes[1], states, (lower[0], upper[0], lower[1], upper[1]), None)
    axes[1].plot(path[:, 0], path[:, 1], color=PATH, linewidth=2.0)
    axes[1].plot(*path[0], "o", color=PATH)
    axes[1].plot(*path[-1], "s", color=PATH)
    axes[1].set(xlabel="shoulder (rad)", ylabel="elbow (rad)", title="the map of its joints")
    handles = [
        Patch(facecolor=FREE, edgecolor=GRID, label="FREE"),
        Patch(facecolor=MIXED, label="MIXED"),
        Patch(facecolor=BLOCKED, label="BLOCKED"),
        plt.Line2D([], [], color=PATH, label="path"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=8.5)
    return figure


def draw_spheres() -> Figure:
    """Draw a robot of two links from the side, covered by few and by more spheres."""
    shapes = {
        "base": '<origin xyz="0 0 0.2"/><geometry><cylinder radius="0.15" length="0.4"/></geometry>',
        "arm": '<origin xyz="0.4 0 0"/><geometry><box size="0.9 0.14 0.2"/></geometry>',
    }
    links = "".join(
        f'<link name="{name}"><collision>{shape}</collision></link>'
        for name, shape in shapes.items()
    )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "small.urdf"
        file.write_text(
            f'<robot name="small">{links}<joint name="hinge" type="revolute"><parent link="base"/>'
            '<child link="arm"/><origin xyz="0 0 0.52"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint></robot>'
        )
        arm = cspace.Arm.from_urdf(file)
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 3.6), layout="constrained")
    for ax, number in zip(axes, (2, 8), strict=True):
        model = arm.spheres(number=number)
        farthest = max(balls.hausdorff.upper for balls in model.links.values())
        for low, size in (((-0.15, 0.0), (0.3, 0.4)), ((-0.05, 0.42), (0.9, 0.2))):
            ax.add_patch(Rectangle(low, *size, facecolor=ROBOT))
        for name, height in (("base", 0.0), ("arm", 0.52)):
            balls = model.links[name]
            for (x, _, z), radius in zip(balls.centers.tolist(), balls.radii, strict=True):
                style = {"facecolor": PATH, "alpha": 0.13, "linewidth": 0.0}
                ax.add_patch(plt.Circle((x, z + height), radius, **style))
                ax.add_patch(plt.Circle((x, z + height), radius, fill=False, edgecolor=PATH))
        ax.set_title(f"{number} spheres a link: at most {1000 * farthest:.0f} mm beyond it")
        ax.set(xlim=(-0.5, 1.2), ylim=(-0.25, 0.95), aspect="equal", xlabel="x (m)", ylabel="z (m)")
    return figure


# ---- parts of pictures ---------------------------------------------------------------------------


def fill_cells(ax: Axes, cells: NDArray[Any], colors: ListedColormap) -> None:
    """Fill cells indexed ``[x, y]``, with lines between them."""
    ax.pcolormesh(cells.T, cmap=colors, vmin=0, vmax=colors.N - 1, edgecolors=GRID, linewidth=0.6)
    ax.set(aspect="equal", xlim=(-0.05, cells.shape[0] + 0.05), ylim=(-0.05, cells.shape[1] + 0.05))
    ax.axis("off")


def draw_states_in(
    ax: Axes, states: ArrayLike, extent: tuple[float, ...], spacing: float | None
) -> None:
    """Draw states indexed ``[x, y]`` as an image, with lines between cells if their spacing is
    given."""
    ax.imshow(
        np.asarray(states).T,
        origin="lower",
        extent=extent,
        cmap=STATES,
        vmin=0,
        vmax=2,
        interpolation="none",
    )
    if spacing is not None:
        for x in np.arange(extent[0], extent[1] + spacing / 2, spacing):
            ax.plot([x, x], extent[2:], color=GRID, linewidth=0.4)
        for y in np.arange(extent[2], extent[3] + spacing / 2, spacing):
            ax.plot(extent[:2], [y, y], color=GRID, linewidth=0.4)
    ax.set(aspect="equal", xlim=extent[:2], ylim=extent[2:], xlabel="x (m)", ylabel="y (m)")


def centers(grid: cspace.Grid) -> NDArray[np.float64]:
    """Return the centers of all cells of a grid in the plane, shape (nx, ny, 2)."""
    return np.stack(np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij"), axis=-1)


def polygon(shape: Any, **style: Any) -> plt.Polygon:
    """Return the outline of a polygon as a patch."""
    return plt.Polygon(np.array(shape.exterior.coords), **style)


if __name__ == "__main__":
    draw_all(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
