"""Faults put into the product one at a time, to see which tests find them: ``python -m tests.mutants``."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from resource import RLIMIT_CPU, setrlimit

ROOT = Path(__file__).parents[1]
PACKAGES = ("cspace", "planners")
COPIED = (*PACKAGES, "benchmarks", "docs", "examples", "ros", "tests")
MAX_CPU_SECONDS = 900
"""CPU time that a room's tests may take for one fault, after which the system ends them."""


@dataclass(frozen=True)
class Mutant:
    """A fault: one text of one file, replaced."""

    file: str
    old: str
    new: str
    tests: str
    """Folders and files of tests that must find the fault, separated by spaces."""

    @property
    def name(self) -> str:
        """Name of the fault: the file and the new text."""
        return f"{self.file}: {' '.join(self.new.split())}"


MUTANTS = (
    # Regions.
    Mutant(
        "cspace/regions/_growth.py",
        "supports = cells @ normal - HALF_CELL * np.abs(normal).sum()",
        "supports = cells @ normal - 0.5 * np.linalg.norm(normal)",
        "tests/regions/test_free_region.py",
    ),
    Mutant(
        "cspace/regions/_growth.py",
        "HALF_CELL: Final = 0.5 + 2.0 * SLACK",
        "HALF_CELL: Final = 0.5",
        "tests/regions/test_free_region.py",
    ),
    Mutant(
        "cspace/regions/_free_region.py",
        "yaw in (arc.low - 0.5 * ARC_SLACK, arc.high + 0.5 * ARC_SLACK)",
        "yaw in (arc.low, arc.low)",
        "tests/regions/test_free_region.py",
    ),
    Mutant(
        "cspace/regions/_free_region.py",
        "if is_known and is_taken[tuple(cell)]:",
        "if False:",
        "tests/regions/test_free_region.py",
    ),
    Mutant(
        "cspace/regions/_corridor.py",
        "room = region.b - deviation * np.linalg.norm(region.A[:, :dim], axis=1)",
        "room = region.b + np.inf",
        "tests/regions/test_corridor.py",
    ),
    # Reasons.
    Mutant(
        "cspace/reasons/_margins.py",
        "depths = depths - cell.displacement(points) - DEPTH_SLACK * (1.0 + shape.span)",
        "depths = depths - DEPTH_SLACK * (1.0 + shape.span)",
        "tests/reasons/test_explain.py",
    ),
    Mutant(
        "cspace/reasons/_margins.py",
        'outside = space.outside != "free"',
        'outside = space.outside == "blocked"',
        "tests/reasons/test_explain.py",
    ),
    Mutant(
        "cspace/reasons/_margins.py",
        "return np.where(np.arange(axes) < dim, 1.0, LAYER_GAP)",
        "return np.ones(axes)",
        "tests/reasons/test_explain.py",
    ),
    Mutant(
        "cspace/reasons/_windows.py",
        "if _has_known_solids(space) and finer.is_disconnected(start, goal)",
        "if finer.is_disconnected(start, goal)",
        "tests/reasons/test_explain.py",
    ),
    Mutant(
        "cspace/reasons/_removals.py",
        "masks[states_of_slices(without) != FREE] = NEVER",
        "masks[states_of_slices(without) == 2] = NEVER",
        "tests/reasons/test_removals.py",
    ),
    # Rotations.
    Mutant(
        "cspace/_rotations/base.py",
        "chord = 2.0 * math.sin(min(self.covering_angle, math.pi) / 2.0)",
        "chord = 1.9 * math.sin(min(self.covering_angle, math.pi) / 2.0)",
        "tests/raster/test_turns.py",
    ),
    Mutant(
        "cspace/_rotations/quaternion.py",
        'cosines = np.einsum("mki,mi->mk", corners, center).min(axis=1)',
        'cosines = np.einsum("mki,mi->mk", corners, center).mean(axis=1)',
        "tests/rotations/test_quaternion.py",
    ),
    Mutant(
        "cspace/_rotations/yaw.py",
        'np.searchsorted(self.borders, in_cells, side="right") - 1',
        'np.searchsorted(self.borders, in_cells, side="left") - 1',
        "tests/rotations/test_yaw.py",
    ),
    # Rasters.
    Mutant(
        "cspace/_raster/rounded_boxes.py",
        "k_last = min(last_z, math.floor(high_z + half_chord - b0))",
        "k_last = min(last_z, math.floor(high_z + half_chord - b0)) - 1",
        "tests/raster/test_boxes.py",
    ),
    Mutant(
        "cspace/_raster/rounded_boxes.py",
        "grown = RoundedBoxes(boxes.lows - SLACK, boxes.highs + SLACK, radii)",
        "grown = RoundedBoxes(boxes.lows + SLACK, boxes.highs - SLACK, radii)",
        "tests/raster/test_boxes.py",
    ),
    Mutant(
        "cspace/_raster/rounded_segments.py",
        "mark_touched(near_boundary, segments, growth, 0.0, 0.0, SLACK)",
        "mark_touched(near_boundary, segments, 0.8 * growth, 0.0, 0.0, SLACK)",
        "tests/raster/test_turns.py",
    ),
    Mutant(
        "cspace/_raster/triangles.py",
        "displacement = swept.unit_displacement * min(swept.farthest[t], max_axis_distance)",
        "displacement = swept.unit_displacement * min(swept.nearest[t], max_axis_distance)",
        "tests/raster/test_turns.py",
    ),
    # Engines.
    Mutant(
        "cspace/_engines/fft.py",
        'ROUNDOFFS: Final = {"float32": 2.0**-24,',
        'ROUNDOFFS: Final = {"float32": 2.0**-32,',
        "tests/engines/test_fft.py",
    ),
    Mutant(
        "cspace/_engines/fft.py",
        "tiling = Tiling(lower, size, size - reach, precision)",
        "tiling = Tiling(lower, size, size - reach + 1, precision)",
        "tests/engines",
    ),
    Mutant(
        "cspace/_engines/dilation.py",
        "rows = round_up_to_byte(shape[1] + max(rows_before, rows_after))",
        "rows = round_up_to_byte(shape[1] + min(rows_before, rows_after))",
        "tests/engines",
    ),
    Mutant(
        "cspace/_engines/slices.py",
        "sources = image_slices.min(axis=0).tolist()",
        "sources = image_slices.max(axis=0).tolist()",
        "tests/engines/test_slices.py",
    ),
    # Record and updates.
    Mutant(
        "cspace/_record/update.py",
        "first = np.maximum(changed_first - highest_offset, 0)",
        "first = np.maximum(changed_first - highest_offset + 1, 0)",
        "tests/laws tests/record/test_update.py",
    ),
    Mutant(
        "cspace/_record/exterior.py",
        "reached = [*(low - outer.upper), *(high - outer.lower)]",
        "reached = [*(low - outer.upper + 1), *(high - outer.lower)]",
        "tests/laws tests/record/test_exterior.py",
    ),
    Mutant(
        "cspace/_record/save.py",
        "tiles=True).exists()) and saved.holds_only_map()",
        "tiles=True).exists())",
        "tests/record/test_save.py",
    ),
    Mutant(
        "cspace/_record/save.py",
        'if digest.hexdigest() != attributes["digest"]:',
        "if False:",
        "tests/record/test_save.py",
    ),
    Mutant(
        "cspace/_space.py",
        "derived.drop(self)\n        # Checkers",
        "# Checkers",
        "tests/laws tests/record/test_update.py",
    ),
    # Look-ups and motions.
    Mutant(
        "cspace/_queries/edges.py",
        "if not inside and map_.exterior[s, 2 * map_.dim] != FREE:",
        "if not inside and map_.exterior[s, 2 * map_.dim] == FREE:",
        "tests/laws",
    ),
    Mutant(
        "cspace/_rotations/lookup.py",
        "return cell - 1",
        "return cell",
        "tests/laws",
    ),
    Mutant(
        "cspace/_queries/edges.py",
        "turn_fractions(start, angle, low - turn, high + turn)",
        "turn_fractions(start, angle, low, high)",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_queries/edges.py",
        "reach = radius + 0.5 * length / count",
        "reach = radius + 0.2 * length / count",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "radii[: self.space.dim] += self.sag",
        "radii[: self.space.dim] += 0.0",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "np.concatenate([unknown, differences])",
        "np.concatenate([differences, unknown])",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "np.concatenate([driven, starts])",
        "np.concatenate([starts, driven])",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/arms/_snapshots.py",
        "self.outer.padding + self.bound_displacements(deviations)",
        "self.outer.padding + 0.5 * self.bound_displacements(deviations)",
        "tests/arms/test_chunks.py",
    ),
    Mutant(
        "cspace/_queries/edges.py",
        "return closed_cells(min(begin, end) - reach,",
        "return closed_cells(min(begin, end) + reach,",
        "tests/laws",
    ),
    Mutant(
        "cspace/_queries/points.py",
        "return count - 1 if cell == count and coordinate <= upper else cell",
        "return cell",
        "tests/laws tests/queries/test_points.py",
    ),
    # Gates.
    Mutant(
        "cspace/_gates/gate.py",
        'ramps.append(self._brake(now, "twist_now")[1:])',
        'ramps.append(self._brake(now, "twist_now"))',
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "reached = ((now - firsts) * np.sign(now) <= most).all(axis=1)",
        "reached = np.ones(len(firsts), dtype=np.bool_)",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "steps = math.ceil(ratio * (1.0 - LIMIT_ROUNDING))",
        "steps = math.floor(ratio * (1.0 - LIMIT_ROUNDING))",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "np.abs(ramp[:, 0]).sum()",
        "np.abs(ramp[1:, 0]).sum()",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "one[proven:] = one[proven - 1] if proven else start",
        "one[proven:] = start",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "np.where(is_proven[..., np.newaxis], asked, 0.0)",
        "asked",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "np.asarray(~(self.values <= self.limits * (1.0 + LIMIT_ROUNDING)))",
        "np.asarray(self.values > self.limits * (1.0 + LIMIT_ROUNDING))",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "/ (8.0 * per_row**2)",
        "/ (8.0 * per_row**3)",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "counts, first_refused * self.per_row, out=counts)",
        "counts, first_refused, out=counts)",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "headings = yaws - 0.5 * angles",
        "headings = yaws",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "return error * shape if shape.ndim else error",
        "return error * np.ones_like(shape) if shape.ndim else error",
        "tests/gates/test_chunks.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "size + 2.0 * float(np.linalg.norm(part))",
        "size + 0.0 * float(np.linalg.norm(part))",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "halves = np.where(is_number, commands, 0.0) * (0.5 * seconds)",
        "halves = np.where(is_number, commands, 0.0) * seconds",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "reaches = 0.5 * dt * sizes + tracking",
        "reaches = 0.5 * dt * sizes",
        "tests/planners/test_tool_speed.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "rest = 0.5 * dt * max(len(self._brake(now)) - 1, 0)",
        "rest = 0.0",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_gates/gate.py",
        "leaves[-1] = rest <= seconds_of(pose, now, rest, tracking)",
        "leaves[-1] = rest <= seconds_of(pose, wanted, rest, tracking)",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_gates/chunks.py",
        "largest = drive._limit_yaw_rates(speeds)",
        "largest = None",
        "tests/queries/test_vehicles.py",
    ),
    # Components, distances and searches.
    Mutant(
        "cspace/_queries/components.py",
        "join_nodes(outside[[first]], outside[[second]], parents)",
        "pass",
        "tests/queries/test_components.py",
    ),
    Mutant(
        "cspace/_queries/distance.py",
        "spread += share * (1.0 - share)",
        "spread += 0.5 * share * (1.0 - share)",
        "tests/laws",
    ),
    Mutant(
        "cspace/_queries/distance.py",
        "high = last + 1.0",
        "high = last + 0.0",
        "tests/queries/test_clearance.py",
    ),
    Mutant(
        "planners/_searches/chains.py",
        "if is_inside and graph.states[number, u, v, w] == FREE:",
        "if is_inside and graph.states[number, u, v, w] <= 1:",
        "tests/planners/test_cell_searches.py",
    ),
    Mutant(
        "cspace/_queries/any_angle.py",
        "low_end = False, low, intervals.low_corner[interval], (run_low, seen_low), (run_low, low)",
        "low_end = False, low, intervals.low_corner[interval], (low, seen_low), (run_low, low)",
        "tests/planners/test_lengths.py",
    ),
    Mutant(
        "cspace/_queries/any_angle.py",
        "return round(y) if abs(y - round(y)) < GRAZING else y",
        "return y",
        "tests/planners/test_lengths.py",
    ),
    # Exact geometry.
    Mutant(
        "cspace/_exact/plane.py",
        "parts[pending, 0] = center + proven",
        "parts[pending, 0] = center + 2.0 * proven",
        "tests/exact tests/test_proofs.py",
    ),
    Mutant(
        "cspace/_exact/proofs.py",
        "elif not containment.outer[i, j, m]:",
        "elif not containment.inner[i, j, m]:",
        "tests/exact tests/test_proofs.py",
    ),
    Mutant(
        "cspace/_exact/plane.py",
        "best = min(best, distance - spans[k])",
        "best = max(best, distance - spans[k])",
        "tests/exact tests/test_proofs.py",
    ),
    Mutant(
        "cspace/_exact/rigid.py",
        "best = min(best, slack - spans[k])",
        "best = max(best, slack - spans[k])",
        "tests/exact tests/test_proofs.py",
    ),
    Mutant(
        "cspace/_exact/boundaries.py",
        "if high[axis] > grid.upper[axis]:",
        "if high[axis] > grid.upper[axis] + 1.0:",
        "tests/exact/test_boundaries.py",
    ),
    # Shapes and bodies.
    Mutant(
        "cspace/_queries/leaving.py",
        "near[:, :, layers].any(axis=2)",
        "near.any(axis=2)",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_exact/boundaries.py",
        "first_axis = 2 if on_floor else workspace.grid.dim",
        "first_axis = workspace.grid.dim",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_shapes/layers.py",
        "return first >= 0 and stop <= self.layers",
        "return True",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_shapes/layers.py",
        "SLACK * spacing)",
        "0.0)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_shapes/layers.py",
        "math.floor((top - self.lowest) / spacing + SLACK) + 1",
        "math.floor((top - self.lowest) / spacing)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_exact/segment_proofs.py",
        "gap_below = min(a_height, 0.0) - max(b0_height, b1_height)",
        "gap_below = min(a_height, 0.0) - b0_height",
        "tests/exact/test_segment_proofs.py",
    ),
    Mutant(
        "cspace/_bodies/crossings.py",
        "        and _side_of_plane(p, (q, b[2], b[0]), tolerance) == turn\n",
        "",
        "tests/bodies/test_crossings.py",
    ),
    Mutant(
        "cspace/_bodies/hulls.py",
        "slack = math.sqrt(squared_distance) - ball_radius - motion.required - speed",
        "slack = math.sqrt(squared_distance) - ball_radius - motion.required",
        "tests/arms/test_hulls.py",
    ),
    Mutant(
        "cspace/_shapes/bodies.py",
        "is_outside = winding.evaluate(corners) <= 0",
        "is_outside = winding.evaluate(corners) < 0",
        "tests/shapes/test_bodies.py",
    ),
    Mutant(
        "cspace/_shapes/balls.py",
        "return rounded_rasters(balls, spacing, margin + growth, growth)",
        "return rounded_rasters(balls, spacing, margin + growth, 0.0 * growth)",
        "tests/raster/test_turns.py",
    ),
    Mutant(
        "cspace/_shapes/balls.py",
        "first_corners = len(corners) * np.arange(len(self.radii))",
        "first_corners = len(self.radii) * np.arange(len(self.radii))",
        "tests/shapes/test_shape.py",
    ),
    # Floors.
    Mutant(
        "cspace/_shapes/layers.py",
        "first = math.floor((bottom - self.lowest) / spacing - SLACK)",
        "first = math.ceil((bottom - self.lowest) / spacing - SLACK)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_shapes/layers.py",
        "cls(grid.lower[2] - floor, grid.shape[2])",
        "cls(grid.lower[2], grid.shape[2])",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_shapes/layers.py",
        "low = heights.lowest + spacing * layer",
        "low = heights.lowest + spacing * (layer + 0.5)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_record/contents.py",
        "if not (bottom - room <= lowest and highest <= top + room):",
        "if not bottom - room <= lowest:",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_record/contents.py",
        "layers = heights.find_layers(self.robot.shape, scene.grid.spacing)",
        "layers = slice(None)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_builder.py",
        "math.floor(1000.0 * (high - bottom) + 1.0)",
        "math.floor(1000.0 * (high - bottom))",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_queries/leaving.py",
        "return [RobotPart(split_shape(part), layers)",
        "return [RobotPart(split_shape(part), None)",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_shapes/prism.py",
        "(tops <= self.high - room)",
        "(bottoms <= self.high - room)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_shapes/prism.py",
        "is_touched = (bottoms <= self.high + room)",
        "is_touched = (tops <= self.high + room)",
        "tests/test_floor.py",
    ),
    Mutant(
        "cspace/_space.py",
        "grid.upper[2] + grid.spacing)",
        "grid.lower[2] + grid.spacing)",
        "tests/test_floor.py",
    ),
    # Arms.
    Mutant(
        "cspace/_bodies/cones.py",
        "speed + 0.5 * half * turn * turn",
        "speed + 0.1 * half * turn * turn",
        "tests/arms/test_upright.py",
    ),
    Mutant(
        "cspace/_bodies/cones.py",
        "min(turn, speed + ",
        "min(0.5 * turn, speed + ",
        "tests/arms/test_upright.py",
    ),
    Mutant(
        "cspace/arms/_snapshots.py",
        "self.outer.cones.tolerances - self._bound_turns(deviations)",
        "self.outer.cones.tolerances - 0.3 * self._bound_turns(deviations)",
        "tests/arms/test_upright.py",
    ),
    Mutant(
        "planners/_result.py",
        "exact=self.exact, keep=self.keep)",
        "exact=self.exact)",
        "tests/arms/test_upright.py",
    ),
    Mutant(
        "cspace/_bodies/chain.py",
        "rate = chain.factors[b] * motion",
        "rate = motion",
        "tests/arms/test_space.py",
    ),
    Mutant(
        "cspace/_bodies/chain.py",
        "curvature += (0.5 * rate + rotation) * travel",
        "curvature += 0.5 * rate * travel",
        "tests/arms/test_space.py",
    ),
    Mutant(
        "cspace/_bodies/scenes.py",
        "levers=np.linalg.norm(np.abs(boxes[:, :3]) + boxes[:, 3:6], axis=1)",
        "levers=np.linalg.norm(boxes[:, 3:6], axis=1)",
        "tests/arms/test_space.py",
    ),
    Mutant(
        "cspace/arms/_snapshots.py",
        "others = frozenset(partners[solid.name] - names_of_body[solid.body])",
        "others = frozenset[str]()",
        "tests/arms/test_space.py",
    ),
    Mutant(
        "cspace/arms/_snapshots.py",
        "before.obstacles.get(name) is placed and before.reach == reach",
        "before.obstacles.get(name) is placed",
        "tests/arms/test_living.py",
    ),
    Mutant(
        "cspace/_bodies/hulls.py",
        "away = joint_displacement(axes, center, ball_radius + limit)",
        "away = 0.0",
        "tests/arms/test_joint_map.py",
    ),
    Mutant(
        "cspace/arms/_joint_maps/joint_map.py",
        "last_cells[last_cells == FREE] = MIXED",
        "last_cells[last_cells == FREE] = FREE",
        "tests/arms/test_joint_map.py",
    ),
    Mutant(
        "cspace/arms/_joint_maps/joint_map.py",
        "last = np.where(upper_limits > highest, FARTHEST_CELL, np.array(grid.shape) - 1)",
        "last = np.array(grid.shape) - 1",
        "tests/arms/test_joint_map.py",
    ),
    Mutant(
        "cspace/arms/_inverse.py",
        "turns = np.clip(np.rint((near - q) / math.tau), fewest, most)",
        "turns = np.rint((near - q) / math.tau)",
        "tests/arms/test_inverse.py",
    ),
    Mutant(
        "cspace/arms/_reading/link_shapes.py",
        "np.linalg.solve(poses[links[0]], poses[name])",
        "np.asarray(poses[name])",
        "tests/arms/test_rigid_robots.py",
    ),
    Mutant(
        "cspace/arms/_reading/link_shapes.py",
        "upper = np.flatnonzero(vertices[:, 2] > 0.0)",
        "upper = np.flatnonzero(vertices[:, 2] < 0.0)",
        "tests/arms/test_moveit_solids.py",
    ),
    Mutant(
        "cspace/arms/_reading/link_shapes.py",
        "item.pose @ pose",
        "pose @ item.pose",
        "tests/arms/test_moveit_solids.py",
    ),
    Mutant(
        "cspace/arms/_reading/link_shapes.py",
        "touch_links = tuple(item.touch_links)",
        "touch_links = ()",
        "tests/arms/test_moveit.py",
    ),
    Mutant(
        "cspace/arms/_reading/moveit_messages.py",
        "if np.abs(motion - np.eye(4)).max() > 1e-6:",
        "if np.abs(motion - np.eye(4)).max() > 10.0:",
        "tests/arms/test_moveit.py",
    ),
    Mutant(
        "cspace/arms/_reading/moveit_messages.py",
        "enumerate(PRIMITIVES, 1)}",
        "enumerate(PRIMITIVES, 0)}",
        "tests/arms/test_moveit.py",
    ),
    Mutant(
        "cspace/arms/_reading/urdf.py",
        "mimic.offset += mimic.multiplier * leader.offset",
        "mimic.offset += leader.offset",
        "tests/arms/test_rigid_robots.py",
    ),
    Mutant(
        "cspace/arms/_reading/urdf.py",
        "joint.mimic.offset * joint.axis / np.linalg.norm(joint.axis)",
        "joint.mimic.offset * joint.axis",
        "tests/arms/test_rigid_robots.py",
    ),
    Mutant(
        "cspace/arms/_reading/urdf.py",
        'for joint in below[name] if joint.type == "fixed"]',
        "for joint in below[name]]",
        "tests/arms/test_rigid_robots.py",
    ),
    Mutant(
        "cspace/arms/_reading/urdf.py",
        "allowed.pop(_sort_pair(*names), None)",
        "pass",
        "tests/arms/test_model.py",
    ),
    Mutant(
        "cspace/arms/_reading/sphere_files.py",
        'table.refuse("collision_sphere_buffer", 0, rule=rule)',
        "pass",
        "tests/arms/test_spheres.py",
    ),
    Mutant(
        "cspace/arms/_reading/urdf.py",
        "self._list_joints_above(base) ^ self._list_joints_above(tip)",
        "self._list_joints_above(base) | self._list_joints_above(tip)",
        "tests/arms/test_model.py",
    ),
    Mutant(
        "cspace/arms/_reading/link_shapes.py",
        'if spec["kind"] == "box" and np.array_equal(rotation, np.eye(3)):',
        'if spec["kind"] == "box":',
        "tests/arms/test_scenes.py",
    ),
    Mutant(
        "cspace/arms/_reading/link_shapes.py",
        "shape.centers @ rotation.T + translation",
        "shape.centers + translation @ rotation",
        "tests/arms/test_scenes.py",
    ),
    # Planners: drives, states, results.
    Mutant(
        "planners/_edges/differential.py",
        "and (yaw == yaw1 or is_free(x1, y1, yaw, x1, y1, yaw1))",
        "and (yaw == yaw1 or is_free(x0, y0, yaw0, x0, y0, yaw))",
        "tests/planners/test_local_planner.py",
    ),
    Mutant(
        "planners/_edges/local_planner.py",
        "self.cells.clearance(q) - 0.5 * pieces.lengths[rows]",
        "self.cells.clearance(q) - 0.25 * pieces.lengths[rows]",
        "tests/planners/test_result.py",
    ),
    Mutant(
        "planners/_stages.py",
        "if self.edges.exact else self.is_connected",
        "",
        "tests/planners/test_without_path.py",
    ),
    Mutant(
        "planners/_stages.py",
        "[stage.choices for stage in self.stages], True",
        "[stage.choices for stage in self.stages[:2]], True",
        "tests/planners/test_journeys.py",
    ),
    Mutant(
        "planners/_goals.py",
        "_find_components_met(space, rooms, mixed) for rooms in places",
        "_find_components_met(space, rooms, mixed) for rooms in places[:2]",
        "tests/planners/test_journeys.py",
    ),
    Mutant(
        "planners/_journey.py",
        "number = 1 + bisect_left(",
        "number = 2 + bisect_left(",
        "tests/planners/test_journeys.py",
    ),
    Mutant(
        "planners/_journey.py",
        "starts, routes = choice.task.starts, choice.others",
        "return best, searched",
        "tests/planners/test_journeys.py",
    ),
    Mutant(
        "planners/_edges/local_planner.py",
        "radians = self.rotation_weight * float(np.linalg.norm(rotation))",
        "radians = 2.0 * self.rotation_weight * float(np.linalg.norm(rotation))",
        "tests/planners/test_objectives.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "turn = half if steer != 0 else 0.0",
        "turn = 0.0",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "reach, radius * half, drift",
        "reach, 0.9 * radius * half, drift",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "(0.5 * turn * turn + spare)",
        "spare",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/cars.py",
        "return length if proofs_of(self.cells).is_outside(*start) else -1.0",
        "return length",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "return (t, -quarter, 2.0 - straight, phi - quarter - t, 0.0)",
        "return (t, -quarter, straight - 2.0, phi - quarter - t, 0.0)",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "if count > 0 and totals[row] <= shortest + tie:",
        "if count > 0 and totals[row] < shortest:",
        "tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_searches/guide.py",
        "v -= directions.moves[direction, option, 1]",
        "v += directions.moves[direction, option, 1]",
        "tests/planners/test_guide.py",
    ),
    Mutant(
        "planners/_searches/taut.py",
        "gates[end, 0] = point[0]",
        "gates[end, 0] += 0.0",
        "tests/planners/test_lengths.py",
    ),
    Mutant(
        "planners/_searches/taut.py",
        "end == apex != other_end",
        "end == apex != other_end - side",
        "tests/planners/test_taut.py",
    ),
    Mutant(
        "planners/_searches/guide.py",
        "n_passable += 1",
        "n_passable += 0",
        "tests/planners/test_guide.py",
    ),
    Mutant(
        "planners/_searches/lattice.py",
        "return self._cost <= nodes.progress.keys[0] or is_over(until)",
        "return True",
        "tests/planners/test_cheap_drives.py",
    ),
    Mutant(
        "planners/_searches/lattice.py",
        "return min(paths, key=edges.path_cost, default=path), reason",
        "return path, reason",
        "tests/planners/test_cheap_drives.py",
    ),
    Mutant(
        "planners/_searches/lattice.py",
        "return room_at_goal < room_at_start",
        "return False",
        "tests/planners/test_lattice.py",
    ),
    Mutant(
        "planners/_route_search.py",
        "best = min(found",
        "best = max(found",
        "tests/planners/test_replanning.py",
    ),
    Mutant(
        "planners/_replanning.py",
        "tail = way[blocked[-1] + 1 :]",
        "tail = way[blocked[-1] :]",
        "tests/planners/test_replanning.py",
    ),
    Mutant(
        "planners/_route_search.py",
        "proven=len(path) > 0 and task.edges.are_free(path)",
        "proven=len(path) > 0",
        "tests/planners/test_plan.py",
    ),
    Mutant(
        "planners/_plan.py",
        "goal=frozen(np.array(endpoints[max(reached, 1)]))",
        "goal=frozen(np.array(endpoints[1]))",
        "tests/arms/test_pose_goals.py",
    ),
    # Goals with room, and places on the way.
    Mutant(
        "planners/_goals.py",
        "spacing * cells - slack",
        "spacing * cells + 1e3 * slack",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "batches = itertools.chain(batches, [outside[np.newaxis]])",
        "pass",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "for room in wide]\n",
        "for room in wide[:1]]\n",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "return points if len(found) == len(places) else ()",
        "return points",
        "tests/planners/test_own_space.py",
    ),
    Mutant(
        "planners/_journey.py",
        "return least < best.cost",
        "return least <= 0.0",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_journey.py",
        "return edges.path_cost(path) + _measure_onward(edges, path[-1], onward)",
        "return edges.path_cost(path)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_edges/differential.py",
        "path[max(row - 1, 0) : row + 2, :2], min(row, 1)",
        "path[row - 1 : row + 2, :2], 1",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "best = rows[int(space.distance(rows, free).argmin())]",
        "best = rows[0]",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_motion/smoothing.py",
        "right = np.append(forces.T / scale, sums)",
        "right = np.append(forces.T / scale, 0.0 * sums)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_result.py",
        "edges = self._edges_on(space)\n        check_axes",
        "edges = self._edges_on(self.space or space)\n        check_axes",
        "tests/planners/test_result.py",
    ),
    Mutant(
        "planners/_ompl/search.py",
        "return seconds_late < 0.0",
        "return seconds_late < GRACE_SECONDS",
        "tests/planners/test_deadline.py",
    ),
    Mutant(
        "planners/_edges/integrals.py",
        "share = (step + 0.5) / steps",
        "share = (step + 1.0) / steps",
        "tests/planners/test_objectives.py",
    ),
    Mutant(
        "planners/_goals.py",
        "<= self.radius\n        else:",
        "<= 1.1 * self.radius\n        else:",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "(turns <= self.angle)",
        "(turns <= 1.1 * self.angle)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "<= self.radius + slack)",
        "<= 0.7 * self.radius)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "if self.region is None and self.angle < math.pi:",
        "if False:",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "return labels[labels >= 0]",
        "return labels",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "totals[~space.grid.contains(ends[:, : space.dim])] = np.inf",
        "pass",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "if totals[k] > done[-1]:",
        "if False:",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        'rows[np.argsort(space.distance(here, rows), kind="stable")]',
        'rows[np.argsort(-space.distance(here, rows), kind="stable")]',
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "    if metres:",
        "    if False:",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "inside = shapely.intersects_xy(self.region, rows",
        "inside = shapely.intersects_xy(self.region.envelope, rows",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "kept[kept] = edges.space.motion_is_free(rows[kept], rows[kept])",
        "pass",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "np.asarray(nearest + shares[:, np.newaxis] * steps)",
        "np.asarray(nearest)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_journey.py",
        "ends = np.cumsum(list(map(len, paths))) - 1",
        "ends = np.cumsum(list(map(len, paths)))",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_journey.py",
        "*(each.path[1:] for each in results[1:])",
        "*(each.path for each in results[1:])",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_journey.py",
        "if best.result.proven and not _may_cost_less(task, route, least, best, onward):",
        "if best.result.proven:",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_journey.py",
        "goal=route[max(reached, 1)])",
        "goal=route[-1])",
        "tests/planners/test_journeys.py",
    ),
    Mutant(
        "planners/_stages.py",
        "room.angle >= math.pi and room.contains(",
        "room.contains(",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_stages.py",
        "return edges.turns_at(path, row) and not self.takes_any_yaw(edges, path[row])",
        "return edges.turns_at(path, row)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_stages.py",
        "answers = (True,) if is_proof else (True, None)",
        "answers = (True,)",
        "tests/planners/test_own_space.py",
    ),
    Mutant(
        "planners/_stages.py",
        "in answers for q in reached)",
        "in answers for q in reached[:1])",
        "tests/planners/test_journeys.py",
    ),
    Mutant(
        "planners/_replanning.py",
        "tail = way[blocked[-1] + 1 :] if",
        "tail = way[blocked[0] + 1 :] if",
        "tests/planners/test_replanning.py",
    ),
    Mutant(
        "planners/_replanning.py",
        "left = np.append(np.cumsum(costs[::-1])[::-1], 0.0)",
        "left = np.append(np.cumsum(costs), 0.0)",
        "tests/planners/test_replanning.py",
    ),
    Mutant(
        "planners/_goals.py",
        "radians = parts.near.angle if",
        "radians = 0.5 * parts.near.angle if",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "min(angle + radians, math.pi)",
        "angle",
        "tests/planners/test_goals.py",
    ),
    # Planners: trajectories.
    Mutant(
        "planners/_motion/jerk.py",
        "share = twist + bend + along",
        "share = along",
        "tests/planners/test_jerk.py",
    ),
    Mutant(
        "planners/_motion/jerk.py",
        "even = speed + acceleration * abs(acceleration) / (2.0 * jerk)",
        "even = speed",
        "tests/planners/test_jerk.py",
    ),
    Mutant(
        "planners/_motion/jerk.py",
        "is_key[1:] |= is_faster",
        "is_key[:-1] |= is_faster",
        "tests/planners/test_jerk.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "rounding = roundings * float",
        "rounding = 0.0 * float",
        "tests/planners/test_jerk.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "phases.jerks / factor**3",
        "phases.jerks / factor**2",
        "tests/planners/test_jerk.py",
    ),
    Mutant(
        "planners/_motion/smoothing.py",
        "shifts * junction.rates + bends",
        "shifts * junction.rates",
        "tests/planners/test_going_on.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "1.0 - intervals.bend_shares[k] * speed**2, 0.0",
        "1.0 - 0.0 * intervals.bend_shares[k], 0.0",
        "tests/planners/test_going_on.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "kept = segments.select(slice(first, last + 1))",
        "kept = segments",
        "tests/planners/test_going_on.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "phases.accelerations / factor**2",
        "phases.accelerations / factor",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "1.0 / self.shares(rates).max(axis=1)",
        "1.0 / self.shares(rates).min(axis=1)",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "reached = (2.0 * length + rate * square)",
        "reached = (4.0 * length + rate * square)",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/_motion/segments.py",
        "half = 0.5 * curvatures * s[arcs]",
        "half = -0.5 * curvatures * s[arcs]",
        "tests/planners/test_trajectory.py",
    ),
    Mutant(
        "planners/_motion/segments.py",
        "crosses += eighths * np.abs(_cross(both_bends[0], twists))",
        "crosses *= 0.99",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "planners/_motion/segments.py",
        "radii = np.column_stack([radii[:, :dim], 0.5 * turns])",
        "radii = np.column_stack([radii[:, :dim], 0.1 * turns])",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "planners/_motion/segments.py",
        "np.repeat(begins, CUTS) + np.arange(len(parts)) % CUTS * widths",
        "np.repeat(begins, CUTS)",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "planners/_motion/segments.py",
        "fits: Bools = turns <= MAX_EDGE_TURN",
        "fits: Bools = turns <= 9.0",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "planners/_motion/segments.py",
        "radii = bends * widths[:, np.newaxis] ** 2 / 8.0",
        "radii = bends * 0.0",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "cspace/arms/_snapshots.py",
        "paddings = self.outer.padding + self.bound_displacements(deviations)",
        "paddings = self.outer.padding",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "allowed = max(MAX_RATE_STEP, bounds.gap) * largest",
        "allowed = 10.0 * largest",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "planners/_motion/timing.py",
        "shares = [bounds.velocity.shares(rates) ** 2, bend_shares]",
        "shares = [0.8 * bounds.velocity.shares(rates) ** 2, bend_shares]",
        "tests/planners/test_smoothing.py",
    ),
    Mutant(
        "cspace/lanes/_apart.py",
        "moved = halves * (np.minimum(speeds, relative) + turns) * (1.0 + SPEED_ROUNDING)",
        "moved = 0.4 * halves * (np.minimum(speeds, relative) + turns)",
        "tests/lanes/test_apart.py",
    ),
    Mutant(
        "cspace/lanes/_apart.py",
        "errors = one.bound_errors(highs) + other.bound_errors(highs)",
        "errors = one.bound_errors(highs)",
        "tests/lanes/test_apart.py",
    ),
    Mutant(
        "cspace/lanes/_apart.py",
        "timed = driven + changing or movers",
        "timed = driven or changing or movers",
        "tests/lanes/test_apart.py",
    ),
    Mutant(
        "planners/_motion/trajectory.py",
        "around = lever * np.linalg.norm(rates[:, dim:], axis=1)",
        "around = 0.0 * ahead",
        "tests/lanes/test_apart.py",
    ),
    # Limits of speed.
    Mutant(
        "planners/_motion/joint_limits.py",
        "has_limit = table.flag(flag)",
        "has_limit = True",
        "tests/arms/test_messages.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "lowest[rows[::-1]] = self.levels.speeds[levels[::-1]]",
        "lowest[rows] = self.levels.speeds[levels]",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "touches |= shapely.dwithin(areas, bodies[numbers], reached + radius)",
        "touches |= shapely.dwithin(areas, bodies[numbers], reached)",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "anchors, reached + self.size)",
        "anchors, reached)",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "np.where(gaps - reaches < distance, speed, np.inf)",
        "np.where(gaps < distance, speed, np.inf)",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "grades = np.floor(",
        "grades = np.ceil(",
        "tests/planners/test_tool_speed.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "(sizes[0] + rule.lever * sizes[1])",
        "sizes[0]",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "travel = (ahead + rule.lever * turning)",
        "travel = ahead",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "reaches = halves * travel[numbers]",
        "reaches = 0.0 * travel[numbers]",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "max(largest, radius - geometry.distance(origin))",
        "max(largest, radius + geometry.distance(origin))",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "ZoneRule(zones, None, size, size, False, 0.0, step)",
        "ZoneRule(zones, None, 0.0, 0.0, False, 0.0, step)",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "lever = _measure_size(near.space) if near.space.rotations.names else 0.0",
        "lever = 0.0",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "is_sure &= (depths < 0.0) | ~shapely.dwithin(borders[levels], anchors, depths)",
        "pass",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/speed_limits.py",
        "[:, :dim].max(axis=0)",
        "[:, :dim].min(axis=0)",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "planners/_motion/zone_files.py",
        "elif 0.0 < speed <= most:",
        "elif 0.0 < speed:",
        "tests/planners/test_zone_files.py",
    ),
    Mutant(
        "planners/_motion/zone_files.py",
        "speed = base + multiplier * value",
        "speed = multiplier * (base + value)",
        "tests/planners/test_zone_files.py",
    ),
    Mutant(
        "planners/_motion/zone_files.py",
        '{"s": 1.0, "min": 60.0, "h": 3600.0}',
        '{"s": 1.0, "min": 1.0, "h": 3600.0}',
        "tests/planners/test_zone_files.py",
    ),
    Mutant(
        "planners/_motion/zone_files.py",
        'if (length, time) == ("m", "h"):',
        "if False:",
        "tests/planners/test_zone_files.py",
    ),
    # Lanes.
    Mutant(
        "cspace/lanes/_lane_motions.py",
        "chain = [*yaws, yaw, *yaws[:-1][:1]]",
        "chain = [*yaws, yaw]",
        "tests/lanes/test_audit.py",
    ),
    Mutant(
        "cspace/lanes/_conflicts.py",
        "touches.found & (not (has_floor[one] or has_floor[other]))",
        "touches.found",
        "tests/lanes/test_audit.py",
    ),
    Mutant(
        "cspace/lanes/_outlines.py",
        "bulges = body.lever * (turns**2 + (2.0 * pieces.half_widths) ** 2) / 8.0",
        "bulges = 0.0 * turns",
        "tests/lanes/test_conflicts.py",
    ),
    Mutant(
        "cspace/lanes/_outlines.py",
        "growths = pieces.growths + bulges + (radius + body.margin)",
        "growths = pieces.growths + bulges + radius",
        "tests/lanes/test_conflicts.py",
    ),
    Mutant(
        "cspace/lanes/_outlines.py",
        "is_short = highs - lows <= math.pi + TURN_SLACK",
        "is_short = highs - lows < math.pi",
        "tests/lanes/test_conflicts.py",
    ),
    Mutant(
        "cspace/lanes/_outlines.py",
        "shares = np.where(sweeper.pieces.on_lane[rows[owners]], shares, np.rint(shares))",
        "shares = np.where(sweeper.pieces.on_lane[rows[owners]], shares, shares)",
        "tests/lanes/test_conflicts.py",
    ),
    # Files and exports.
    Mutant(
        "cspace/_files/images.py",
        "levels[part] = total[::-1].T",
        "levels[part] = total.T",
        "tests/files/test_image.py",
    ),
    Mutant(
        "cspace/_files/images.py",
        'elif image.mode == "I" or maximum',
        "elif False or maximum",
        "tests/files/test_image.py",
    ),
    Mutant(
        "cspace/_files/rasters.py",
        "lower[index] = centers[0] - 0.5 * spacing",
        "lower[index] = centers[0]",
        "tests/files/test_rasters.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "doubtful: Bools = free_levels & unknown",
        "doubtful: Bools = free_levels & ~free_levels",
        "tests/files/test_rosmap.py",
    ),
    Mutant(
        "cspace/_files/octomap.py",
        "first = np.floor(lower + _BOUND_SLACK)",
        "first = np.ceil(lower + _BOUND_SLACK)",
        "tests/files/test_octomap.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "return values.reshape(height, width)",
        "return values.reshape(width, height)",
        "tests/files/test_messages.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "free_levels = probability < header.free_thresh",
        "free_levels = probability <= header.free_thresh",
        "tests/files/test_rosmap.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "return 2.0 * math.atan2(z, w)",
        "return -2.0 * math.atan2(z, w)",
        "tests/files/test_messages.py",
    ),
    Mutant(
        "cspace/_files/meshes.py",
        "to_metres = _make_affine(metres_per_unit * np.eye(3))",
        "to_metres = _make_affine(np.eye(3))",
        "tests/files/test_mesh_scenes.py",
    ),
    Mutant(
        "cspace/_files/meshes.py",
        "start < 0 or count < 1 or stride < record.itemsize or end > len(content)",
        "start < 0 or count < 1 or stride < record.itemsize",
        "tests/files/test_mesh_scenes.py",
    ),
    Mutant(
        "cspace/_files/polygons.py",
        "if np.linalg.det(linear) < 0.0:",
        "if np.linalg.det(linear) > 0.0:",
        "tests/files/test_mesh_scenes.py",
    ),
    Mutant(
        "cspace/_files/octomap.py",
        '(2, 2, 2), order="F")',
        '(2, 2, 2), order="C")',
        "tests/files/test_octomap.py",
    ),
    Mutant(
        "cspace/_files/octomap.py",
        "leaf_sides = sides[parents] // 2",
        "leaf_sides = sides[parents] // 4",
        "tests/files/test_octomap.py",
    ),
    Mutant(
        "cspace/_files/point_clouds.py",
        "columns = [sum(counts[:field]) for field in fields]",
        "columns = fields",
        "tests/files/test_points.py",
    ),
    Mutant(
        "cspace/_files/zarr_folders.py",
        "elif self._may_miss_chunks:",
        "elif self._fill is not None:",
        "tests/files/test_zarr_folders.py",
    ),
    Mutant(
        "cspace/export/_plane_images.py",
        "(1025, 1),",
        "(1025, 2),",
        "tests/export/test_exports.py",
    ),
    Mutant(
        "cspace/export/_messages.py",
        "np.where(lowest == stack.max(axis=0), lowest, MIXED)",
        "lowest",
        "tests/export/test_map_messages.py",
    ),
    Mutant(
        "cspace/export/_messages.py",
        "costs[clearance + inscribed > radius] = 0",
        "costs[clearance > radius - 2 * inscribed] = 0",
        "tests/export/test_map_messages.py",
    ),
    Mutant(
        "cspace/_files/images.py",
        "if levels.max() > maximum:",
        "if False:",
        "tests/files/test_image.py",
    ),
    Mutant(
        "cspace/_files/images.py",
        "if excess > 0:",
        "if excess > 1:",
        "tests/files/test_image.py",
    ),
    Mutant(
        "cspace/_files/images.py",
        "return np.ascontiguousarray(blocked[::-1].T)",
        "return np.ascontiguousarray(blocked.T)",
        "tests/files/test_movingai.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "values[values > 100.0] = -1.0",
        "pass",
        "tests/files/test_masks.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "occupied_levels = ~free_levels & (probability <= 1.0)",
        "occupied_levels = ~free_levels",
        "tests/files/test_rosmap.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "occupied = is_known & (percent / 100.0 >= high)",
        "occupied = is_known & (percent / 100.0 > high)",
        "tests/files/test_messages.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "if max(abs(x), abs(y)) > 1e-6:",
        "if max(abs(x), abs(y)) > 1.0:",
        "tests/files/test_messages.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        "return CostmapRobot((), radius, padding)",
        "return CostmapRobot((), radius, 0.0)",
        "tests/files/test_nav2.py",
    ),
    Mutant(
        "cspace/_files/ros_maps.py",
        'table.get("footprint_padding", 0.01)',
        'table.get("footprint_padding", 0.0)',
        "tests/files/test_nav2.py",
    ),
    Mutant(
        "cspace/_files/octomap.py",
        "if mask and side == smallest:",
        "if False:",
        "tests/files/test_octomap.py",
    ),
    Mutant(
        "cspace/_files/point_clouds.py",
        'indices = [fields.index(axis) for axis in "xyz" if fields.count(axis) == 1]',
        "indices = [0, 1, 2]",
        "tests/files/test_points.py",
    ),
    Mutant(
        "cspace/_files/point_clouds.py",
        "        if broken:",
        "        if False:",
        "tests/files/test_points.py",
    ),
    Mutant(
        "cspace/_files/vector.py",
        "for system in systems if isinstance(systems, list) else [systems]:",
        "for system in [systems]:",
        "tests/files/test_vector.py",
    ),
    Mutant(
        "cspace/_files/vector.py",
        "if not all(map(is_wkt, lines)):",
        "if False:",
        "tests/files/test_vector.py",
    ),
    Mutant(
        "cspace/_files/vector.py",
        "int(srid or 0))",
        "0)",
        "tests/files/test_vector.py",
    ),
    Mutant(
        "cspace/_files/crs.py",
        "{84, 83, 27, 3857, 900913,",
        "{84, 83, 27, 900913,",
        "tests/files/test_vector.py",
    ),
    Mutant(
        "cspace/_files/rasters.py",
        "array = array.isel({axis: slice(None, None, -1)})",
        "pass",
        "tests/files/test_rasters.py",
    ),
    Mutant(
        "cspace/_files/rasters.py",
        'if positive.lower() == "down" or name == "depth":',
        'if positive.lower() == "down":',
        "tests/files/test_rasters.py",
    ),
    Mutant(
        "cspace/_files/images.py",
        "* (0.01 if note[2] else 1.0)",
        "* 1.0",
        "tests/files/test_heard.py",
    ),
    # Spectral.
    Mutant(
        "cspace/spectral/_trees.py",
        "if square > (reach + slack) * (reach + slack):",
        "if square > (reach - slack) * (reach - slack):",
        "tests/spectral/test_contacts.py",
    ),
    Mutant(
        "cspace/spectral/_early.py",
        "+ placing + tail_a * tail_b",
        "+ placing",
        "tests/spectral/test_overlap.py",
    ),
    Mutant(
        "cspace/spectral/_ball_sets.py",
        "return Balls(balls.centers, largest[size])",
        "return Balls(balls.centers, largest[np.maximum(size - 1, 0)])",
        "tests/spectral/test_overlap.py",
    ),
    Mutant(
        "cspace/spectral/_overlap.py",
        "matrix = rotation_matrix(rotation, self.dim) @ self._rotation",
        "matrix = self._rotation @ rotation_matrix(rotation, self.dim)",
        "tests/spectral/test_overlap.py",
    ),
    Mutant(
        "cspace/spectral/_overlap.py",
        "(moved_part - part)",
        "moved_part",
        "tests/spectral/test_overlap.py",
    ),
    Mutant(
        "cspace/spectral/_decompose.py",
        "stop = math.floor(center + length + 0.5)",
        "stop = math.ceil(center + length + 0.5)",
        "tests/spectral/test_decompose.py",
    ),
    Mutant(
        "cspace/spectral/_regions.py",
        "np.abs(points[block] - centers[nearest]) + half",
        "np.abs(points[block] - centers[nearest])",
        "tests/spectral/test_decompose.py",
    ),
    Mutant(
        "planners/_edges/integrals.py",
        "place = min(max(place, 0.0), count - 1.0)",
        "place = min(max(place, 0.0), count - 1.5)",
        "tests/planners/test_objectives.py",
    ),
    # Tiles.
    Mutant(
        "cspace/_tiles/folder.py",
        "return math.ceil(metres / frame.grid.spacing) + 2",
        "return math.ceil(metres / frame.grid.spacing) - 2",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/labels.py",
        "labels = _pair_up(last_layer, first_layer)",
        "labels = _pair_up(last_layer, last_layer)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/labels.py",
        "if mixed and exterior is not None:",
        "if mixed and exterior is None:",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/open_tiles.py",
        "remaining = np.flatnonzero(out & (inside == is_inside))",
        "remaining = np.flatnonzero(out & inside)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/open_tiles.py",
        "space, rows in self.parts_near(first_cells, self.folder.halo, is_inside)",
        "space, rows in self.parts_near(first_cells, 1, is_inside)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/open_tiles.py",
        "mixed = np.reshape(mixed_cells, (2, -1)) + LAST_TO_STOP - first",
        "mixed = np.reshape(mixed_cells, (2, -1)) - first",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/open_tiles.py",
        "seen[np.ix_(slices, *coarse)] |= ",
        "seen[np.ix_(slices, *coarse)] = ",
        "tests/tiles/test_window.py",
    ),
    Mutant(
        "cspace/_tiles/motions.py",
        "half_turns = np.flatnonzero(angles >= HALF_TURN)",
        "half_turns = np.flatnonzero(angles >= 2.0 * HALF_TURN)",
        "tests/tiles/test_queries.py",
    ),
    Mutant(
        "cspace/_tiles/folder.py",
        "return f\"{self.layout['stamp']} {self.tile_path(tile).name}\"",
        "return f\"{self.layout['stamp']}\"",
        "tests/tiles/test_build.py",
    ),
    # Plot, view and command line.
    Mutant(
        "cspace/plot/_surface.py",
        "if not side or 2 * layers >= len(shares) or (is_cut and axis == 2):",
        "if not side or 2 * layers > len(shares) or (is_cut and axis == 2):",
        "tests/plot/test_surface.py",
    ),
    Mutant(
        "cspace/plot/scene.py",
        "return not plan.recheck(space if is_same else planned).all()",
        "return not plan.recheck(planned).all()",
        "tests/plot/test_picture.py",
    ),
    Mutant(
        "cspace/view/_viewer.py",
        "return is_local(server.hostname) or not is_local(host)",
        "return True",
        "tests/view/test_viewer.py",
    ),
    Mutant(
        "cspace/plot/scene.py",
        "is_clockwise = (up == 1) == (axis == 1)",
        "is_clockwise = up == 1",
        "tests/view/test_scene.py",
    ),
    Mutant(
        "cspace/view/_map_canvas.py",
        "if never_drawn or self._drawn[name] != wanted:",
        "if never_drawn:",
        "tests/view/test_viewer.py",
    ),
    Mutant(
        "cspace/_cli/options.py",
        "if not unit and math.isfinite(value) and abs(value) > 2.0 * math.pi:",
        "if not unit and math.isfinite(value) and value > 2.0 * math.pi:",
        "tests/cli/test_options.py",
    ),
    Mutant(
        "cspace/_cli/files.py",
        "if names != list(axes):",
        "if len(names) != len(axes):",
        "tests/cli/test_hints.py",
    ),
    # C++.
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/surroundings.hpp",
        "if (a[1] <= middle && middle < b[1]) crossings.push_back(x_at(middle));",
        "if (a[1] <= middle && middle < a[1]) crossings.push_back(x_at(middle));",
        "tests/cpp/nav2/test_nav2.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/surroundings.hpp",
        "reach = scale * radius_of_corners_ / side + 1e-6;",
        "reach = 0.7 * scale * radius_of_corners_ / side;",
        "tests/cpp/nav2/test_nav2.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/surroundings.hpp",
        "if (!is_round_ && !is_valid_in_nav2(q)) return false;",
        "",
        "tests/cpp/nav2/test_nav2.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/curves.hpp",
        "sign * mirror * steering * length",
        "mirror * steering * length",
        "tests/cpp/nav2/test_curves.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/curves.hpp",
        "return Lengths{t, -quarter, 2.0 - straight, phi - quarter - t};",
        "return Lengths{t, -quarter, straight - 2.0, phi - quarter - t};",
        "tests/cpp/nav2/test_curves.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/map_maker.hpp",
        "return !error && (is_part || found == needed.size());",
        "return !error;",
        "tests/cpp/nav2/test_gate_node.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/map_maker.hpp",
        "const std::int64_t i = column + static_cast<std::int64_t>(right)",
        "const std::int64_t i = column",
        "tests/cpp/nav2/test_gate_node.py",
    ),
    Mutant(
        "cspace/include/cspace/gate.hpp",
        "if (has_within(taken, -lost_depth_)) return 0.0;",
        "",
        "tests/cpp/test_gate.py",
    ),
    Mutant(
        "planners/_motion/trajectory.py",
        "vias=tuple(row + shift for row in path.vias)",
        "vias=path.vias",
        "tests/planners/test_passing_times.py",
    ),
    Mutant(
        "planners/_motion/trajectory.py",
        "exceeds_until=max(self.exceeds_until - begin, 0.0)",
        "exceeds_until=self.exceeds_until",
        "tests/planners/test_speed_limits.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/lattice.hpp",
        "surroundings_.cost(poses) >= target || !surroundings_.poses_are_free(poses)) continue;",
        "surroundings_.cost(poses) >= target) continue;",
        "tests/cpp/nav2/test_nav2.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/watch.hpp",
        "return {at.x + p.x + 2.0 * (w * cross.x",
        "return {at.x + p.x + 0.0 * (w * cross.x",
        "tests/cpp/nav2/test_watch.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/watch.hpp",
        "const Pose here = move(pose, seen, now);",
        "const Pose here = pose;",
        "tests/cpp/nav2/test_watch.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/watch.hpp",
        "const auto first = look_up(options_.odom_frame, scan.frame, scan.stamp);",
        "const auto first = look_up(options_.odom_frame, scan.frame, NEWEST);",
        "tests/cpp/nav2/test_watch.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/watch.hpp",
        "source.heard = now - std::max<Time>(clock - scan.stamp, 0);",
        "source.heard = now;",
        "tests/cpp/nav2/test_watch.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/footprint.hpp",
        "if (most <= SAME) return true;",
        "return true;",
        "tests/cpp/nav2/test_watch.py",
    ),
    Mutant(
        "cspace/include/cspace/gate.hpp",
        "const double share = 1.0 - static_cast<double>(k) / steps;",
        "const double share = 1.0 - static_cast<double>(k + 1) / steps;",
        "tests/cpp/test_gate.py",
    ),
    Mutant(
        "cspace/include/cspace/gate.hpp",
        "-twist.omega * point.x - twist.side}",
        "-twist.omega * point.x + twist.side}",
        "tests/cpp/test_gate.py",
    ),
    Mutant(
        "ros/cspace_nav2/include/cspace_nav2/watch.hpp",
        "turn({v * seconds * ratio, side * seconds * ratio}, pose.yaw",
        "turn({v * seconds * ratio, 0.0 * side * seconds * ratio}, pose.yaw",
        "tests/cpp/nav2/test_watch.py",
    ),
    Mutant(
        "cspace/include/cspace/gate.hpp",
        "double above = gap.distance - needed;",
        "double above = gap.distance;",
        "tests/cpp/test_gate.py",
    ),
    Mutant(
        "cspace/_queries/leaving.py",
        "np.where(rates >= 0.0, np.maximum",
        "np.where(rates >= -0.1, np.maximum",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_queries/leaving.py",
        "np.where(bends > 0.0, rates / bends, math.inf)",
        "np.where(bends > 0.0, math.inf, math.inf)",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_queries/leaving.py",
        "np.where(over >= -LEVEL_ROUNDING, flows @ normals.T, -math.inf)",
        "flows @ normals.T",
        "tests/queries/test_leaving.py",
    ),
    Mutant(
        "cspace/_queries/leaving.py",
        'contents.outside != "free")',
        "False)",
        "tests/queries/test_leaving.py",
    ),
    # Weights of driving, places near goals, closest points, and times on the way.
    Mutant(
        "planners/_edges/car_curves.py",
        "total = radius * curves.switch_cost * count_switches(words.lengths, 0)",
        "total = curves.switch_cost * count_switches(words.lengths, 0)",
        "tests/planners/test_cheap_drives.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "total = curves.switch_cost * count_switches(all_lengths, row)",
        "total = 0.0",
        "tests/planners/test_cheap_drives.py tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/car_curves.py",
        "total += abs(length) * (curves.reverse_cost if length < 0.0 else 1.0)",
        "total += abs(length)",
        "tests/planners/test_cheap_drives.py tests/planners/test_car_curves.py",
    ),
    Mutant(
        "planners/_edges/differential.py",
        "price = self.drive.reverse_cost",
        "price = 1.0",
        "tests/planners/test_cheap_drives.py",
    ),
    Mutant(
        "planners/_edges/cars.py",
        "return cost + self.drive.switch_cost * changes.count(True)",
        "return cost",
        "tests/planners/test_cheap_drives.py",
    ),
    Mutant(
        "planners/_searches/lattice.py",
        "total += motions.switch_cost",
        "total += 0.0",
        "tests/planners/test_cheap_drives.py",
    ),
    Mutant(
        "planners/_goals.py",
        "is_joined = np.isin(find_components(space, members), joined)",
        "is_joined = np.ones(len(members), dtype=np.bool_)",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "planners/_goals.py",
        "np.lexsort((turns, gaps[order[numbers[is_joined]]]))",
        "np.lexsort((gaps[order[numbers[is_joined]]], turns))",
        "tests/planners/test_goals.py",
    ),
    Mutant(
        "cspace/arms/_model.py",
        "reach = (1.0 + 1e-9) * (self.chain.lengths[0, body] + np.linalg.norm(tool[:3, 3]))",
        "reach = (1.0 + 1e-9) * self.chain.lengths[0, body]",
        "tests/arms/test_inverse.py",
    ),
    Mutant(
        "cspace/_exact/proofs.py",
        "turns = np.cross(points[0] - positions[0], away)",
        "turns = np.cross(points[1] - points[0], away)",
        "tests/exact/test_closest.py",
    ),
    Mutant(
        "cspace/_exact/proofs.py",
        "required = boundaries.required - boundaries.scale * self._margin",
        "required = boundaries.required",
        "tests/exact/test_closest.py",
    ),
    Mutant(
        "planners/_motion/trajectory.py",
        "return proven if proven.all() else proven | self.recheck(space).all()",
        "return proven | True",
        "tests/planners/test_passing_times.py",
    ),
    Mutant(
        "planners/_motion/trajectory.py",
        "cut_phases(self._phases, begin)",
        "cut_phases(self._phases, min(begin + 1.0, self.duration))",
        "tests/planners/test_passing_times.py",
    ),
    Mutant(
        "cspace/_shapes/mesh.py",
        "max(1e-6, 16.0 * _CRACK_WIDTH * span)",
        "1e-6",
        "tests/test_floor.py",
    ),
)


def find_stale() -> list[str]:
    """Return the faults whose old text is not in its file exactly once."""
    return [
        mutant.name
        for mutant in MUTANTS
        if (ROOT / mutant.file).read_text(encoding="utf-8").count(mutant.old) != 1
    ]


class Copy:
    """A copy of the tree for one fault at a time, whose compiled code stays between faults."""

    def __init__(self, folder: Path) -> None:
        """Copy the tree with the times of its files."""
        self.folder = folder
        for part in COPIED:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / part, folder / part, ignore=ignored)
        shutil.copy(ROOT / "pyproject.toml", folder)

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run Python in the copy."""
        cache = str(self.folder / "cache")
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "CSPACE_TEST_CACHE": cache}
        return subprocess.run(
            [sys.executable, *words],
            cwd=self.folder,
            env={**environment, "XDG_CACHE_HOME": cache, "NUMBA_CACHE_DIR": ""},
            capture_output=True,
            text=True,
            check=False,
            preexec_fn=lambda: setrlimit(RLIMIT_CPU, (MAX_CPU_SECONDS, MAX_CPU_SECONDS)),
        )

    @contextmanager
    def fault(self, mutant: Mutant) -> Iterator[None]:
        """Put a fault into the copy."""
        path = self.folder / mutant.file
        text, times = path.read_text(encoding="utf-8"), path.stat()
        path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(text, encoding="utf-8")
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))

    def test(self, tests: Iterable[str], markers: str = "") -> tuple[bool, float, str]:
        """Run tests, those of a set or all, until one fails.

        Returns
        -------
        failed : bool
            True if a test failed.
        seconds : float
            Time until then.
        last : str
            Name of the first test that failed, or the last line of the output.
        """
        start = time.perf_counter()
        options = ["-x", "-q", "-n", "0", "--tb=no", "-m", markers]
        done = self.run("-m", "pytest", *options, *tests)
        lines = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        last = lines[0] if lines else (done.stdout + done.stderr).strip().rpartition("\n")[2]
        failed = done.returncode == 1 or done.returncode < 0  # a failed test, or a crash
        return failed, time.perf_counter() - start, last


def main() -> int:
    """Test all faults, or those whose name contains a given text; return 1 if one survives."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("text", nargs="?", default="", help="only faults with this in their name")
    parser.add_argument("--check", action="store_true", help="only look for each fault's old text")
    parser.add_argument(
        "--quick", action="store_true", help="say which die in thorough tests alone"
    )
    options = parser.parse_args()
    if stale := find_stale():
        print("\n".join(f"old text is not there exactly once: {name}" for name in stale))
        return 1
    if options.check:
        return 0
    chosen = [mutant for mutant in MUTANTS if options.text in mutant.name]
    counts = Counter[str]()
    with tempfile.TemporaryDirectory(prefix="cspace-mutant-") as name:
        copy = Copy(Path(name))
        passed = set[str]()
        for mutant in chosen:
            if mutant.tests not in passed:  # this run compiles what the faults do not change
                failed, seconds, last = copy.test(mutant.tests.split(), "not thorough")
                print(
                    f"{seconds:5.0f} s  {mutant.tests} without a fault\n         {last}", flush=True
                )
                if failed:
                    return 1
                passed.add(mutant.tests)
            verdict, seconds, last = run_sets(copy, mutant, options.quick)
            counts[verdict] += 1
            print(f"{seconds:5.0f} s  {verdict:8}  {mutant.name}\n         {last}", flush=True)
    print(", ".join(f"{counts[verdict]} {verdict}" for verdict in sorted(counts)))
    return 1 if counts["SURVIVED"] else 0


def run_sets(copy: Copy, mutant: Mutant, by_set: bool) -> tuple[str, float, str]:
    """Run a fault's quick tests, then all, or all at once if the sets are not told apart."""
    before = 0.0
    with copy.fault(mutant):
        if by_set:
            failed, before, last = copy.test(mutant.tests.split(), "not thorough")
            if failed:
                return "died", before, last
        failed, seconds, last = copy.test(mutant.tests.split())
    verdict = "died in thorough tests" if by_set else "died"
    return verdict if failed else "SURVIVED", before + seconds, last


if __name__ == "__main__":
    sys.exit(main())
