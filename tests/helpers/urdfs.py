"""Small arms written as URDF files, and boxes at poses."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from scipy.spatial.transform import Rotation

import cspace
from cspace import Robot
from tests.helpers.regions import place_polygon

if TYPE_CHECKING:
    from cspace import Arm
    from cspace.arms import PosedShape


def pose_at(x: float, y: float, z: float = 0.0, rotvec: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the pose at a point, rotated by a rotation vector."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.from_rotvec(rotvec).as_matrix(), (x, y, z)
    return pose


def posed_box(sides: Any, x: float, y: float, z: float = 0.0) -> PosedShape:
    """Return a box around a point."""
    return cspace.arms.PosedShape(Robot.box(sides).shape, pose_at(x, y, z))


def link(name: str, *boxes: tuple[Any, Any], extra: str = "") -> str:
    """Write a link of boxes, given by their sides and centers."""
    return f'<link name="{name}">{"".join(collision("box", *each) for each in boxes)}{extra}</link>'


def collision(kind: str, sizes: Any, at: Any, rpy: Any = (0, 0, 0)) -> str:
    """Write a box, cylinder or sphere of a link."""
    values = zip(("radius", "length"), sizes, strict=False)
    measures = (
        f'size="{_text(sizes)}"'
        if kind == "box"
        else " ".join(f'{key}="{value}"' for key, value in values)
    )
    origin = f'<origin xyz="{_text(at)}" rpy="{_text(rpy)}"/>'
    return f"<collision>{origin}<geometry><{kind} {measures}/></geometry></collision>"


def joint(
    name: str,
    parent: str,
    child: str,
    at: Any = (0, 0, 0),
    axis: Any = (0, 0, 1),
    kind: str = "revolute",
    limits: Any = (-3.0, 3.0),
    rpy: Any = (0, 0, 0),
    extra: str = "",
) -> str:
    limit = (
        ""
        if limits is None
        else f'<limit lower="{limits[0]}" upper="{limits[1]}" effort="1" velocity="1"/>'
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_text(at)}" rpy="{_text(rpy)}"/><axis xyz="{_text(axis)}"/>{limit}{extra}</joint>'
    )


def write_urdf(folder: Path, *parts: str) -> Path:
    """Write a URDF file of links and joints."""
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="small">{"".join(parts)}</robot>')
    return path


def planar(folder: Path, *more: str, elbow: Any = None, **shoulder: Any) -> Path:
    """Write an arm of two links of 1 m in the plane z = 0; ``elbow`` changes its second joint."""
    bar = ((1.0, 0.1, 0.1), (0.5, 0, 0))
    return write_urdf(
        folder,
        link("foot", ((0.05, 0.05, 0.05), (0, 0, -0.2))),
        link("upper", bar),
        link("fore", bar),
        joint("shoulder", "foot", "upper", **shoulder),
        joint("elbow", "upper", "fore", at=(1, 0, 0), **(elbow or {})),
        *more,
    )


@cache
def planar_arm(**shoulder: Any) -> Arm:
    """Return the arm of :func:`planar`."""
    with TemporaryDirectory() as folder:
        return cspace.Arm.from_urdf(planar(Path(folder), **shoulder))


def planar_arm_gaps(q: Any, posts: Any, bars: tuple[str, ...] = ("upper", "fore")) -> np.ndarray:
    """Return the distances of bars of :func:`planar` from posts at configurations, by shapely.

    Posts are given by the coordinates of their centers and their sides. The shape is (bars, n,
    posts).
    """
    first, second = np.transpose(q)
    zero = np.zeros_like(first)
    poses = {
        "upper": (zero, zero, first),
        "fore": (np.cos(first), np.sin(first), first + second),
    }
    bar = shapely.box(0.0, -0.05, 1.0, 0.05)
    placed = np.array([place_polygon(bar, np.stack(poses[name], axis=1)) for name in bars])
    x, y, sides = np.transpose(posts)
    squares = shapely.box(x - sides / 2, y - sides / 2, x + sides / 2, y + sides / 2)
    return np.asarray(shapely.distance(placed[:, :, np.newaxis], squares))


def planar_arm_meets(q: Any, posts: Any) -> np.ndarray:
    """Return whether bars of :func:`planar` meet a post at each configuration, by shapely."""
    return (planar_arm_gaps(q, posts) == 0.0).any(axis=(0, 2))


POSTS = ((0.7, 0.0, 0.3), (-0.9, 1.2, 0.4), (0.2, -1.5, 0.7))
"""Centers of square posts, and their sides, metres; the first stops the shoulder at zero."""

CONTINUOUS = {"kind": "continuous", "limits": None}


def build_plane_arm(posts: Any = POSTS, **shoulder: Any) -> Any:
    """Build the space of two bars of 1 m among posts."""
    shapes = {f"post{k}": posed_box((s, s, 2.0), x, y) for k, (x, y, s) in enumerate(posts)}
    may_touch = [("foot", name) for name in shapes]
    return cspace.build_arm_space(shapes, planar_arm(**shoulder), allowed_collisions=may_touch)


def planar_with_tip(folder: Path, **changes: Any) -> Arm:
    """Return the arm of :func:`planar` with the frame tip at its end."""
    return cspace.Arm.from_urdf(planar(folder, **changes)).attach(
        "tip", Robot.ball(0.01).shape, "fore", pose_at(1, 0)
    )


def poses_apart(pose: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """Return the distance and the angle between two poses, metres and radians."""
    turn = Rotation.from_matrix(pose[:3, :3]).inv() * Rotation.from_matrix(other[:3, :3])
    return float(np.linalg.norm(pose[:3, 3] - other[:3, 3])), float(turn.magnitude())


def post() -> PosedShape:
    """Return a post that only the folded planar arm passes."""
    return posed_box((0.2, 0.2, 1.0), 1.55, 0.6)


SIDES, CENTER = (0.4, 0.1, 0.2), (0.3, 0.0, 0.1)
BALL, RADIUS = (0.1, 0.2, 0.0), 0.15
CORNERS: Any = np.array(CENTER) + 0.5 * np.array(list(itertools.product((-1, 1), repeat=3))) * SIDES
"""Of the links hand and ball of the crane, metres."""


def write_crane(folder: Path) -> Path:
    """Write an arm that turns, lifts, slides and rolls, the last by half of its lift."""
    ball = collision("sphere", (RADIUS,), BALL)
    return write_urdf(
        folder,
        link("base", ((0.1, 0.1, 0.1), (0, 0, -0.3))),
        link("mast"),
        link("boom", ((0.5, 0.1, 0.1), (0.3, 0, 0))),
        link("hand", (SIDES, CENTER)),
        link("ball", extra=ball),
        link("tip"),
        joint("turn", "base", "mast", at=(0.1, 0, 0)),
        joint("lift", "mast", "boom", at=(0.2, 0, 1.0), axis=(0, 1, 0)),
        joint("slide", "boom", "hand", at=(0.5, 0, 0), axis=(0.8, 0, 0.6), kind="prismatic"),
        joint(
            *("roll", "hand", "ball", (0.3, 0, 0), (1, 0, 0)),
            extra='<mimic joint="lift" multiplier="0.5"/>',
        ),
        joint("end", "hand", "tip", at=(0.6, 0, 0), kind="fixed"),
    )


def space_of(**changes: Any) -> Any:
    """Build the space of two links of 1 m beside a post."""
    return cspace.build_arm_space({"post": post()}, planar_arm(**changes))


def write_slider(folder: Path, hand: tuple[Any, Any], axes: str = "xy", **limits: Any) -> Path:
    """Write an arm that moves its hand, a box given by sides and center, along axes."""
    names = ["foot", *(f"along {axis}" for axis in axes[:-1]), "hand"]
    slides = [
        joint(
            axis, *names[k : k + 2], axis=np.eye(3)["xyz".index(axis)], kind="prismatic", **limits
        )
        for k, axis in enumerate(axes)
    ]
    return write_urdf(folder, *map(link, names[:-1]), link("hand", hand), *slides)


def two_arms(folder: Path) -> Path:
    """Write two arms of seven joints beside a column."""
    bar, axes = ((0.2, 0.08, 0.08), (0.1, 0, 0)), ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 0))
    parts = [link("column", ((0.2, 0.3, 1.0), (-0.1, 0, -0.2)))]
    for side, y in (("left", 0.3), ("right", -0.3)):
        for n in range(7):
            parent, at = (f"{side}_{n - 1}", (0.2, 0, 0)) if n else ("column", (0, y, 0))
            parts.append(link(f"{side}_{n}", bar))
            limits = (-3.0, 3.0) if n % 2 == 0 else (-1.9, 1.9)
            parts.append(
                joint(f"{side}_joint_{n}", parent, f"{side}_{n}", at, axes[n % 4], limits=limits)
            )
    return write_urdf(folder, *parts)


def random_arm(folder: Path, seed: int) -> Path:
    """Write an arm with random joints and links of random boxes.

    The last joint mimics the first.
    """
    rng = np.random.default_rng(seed)
    parts = [link("l0", ((0.3, 0.3, 0.1), (0, 0, -0.1)))]
    kinds = rng.choice(["revolute", "prismatic", "continuous"], 4)
    kinds[0] = "revolute"
    for n in range(4):
        boxes = [
            (rng.uniform(0.05, 0.5, 3).round(3), rng.uniform(-0.3, 0.3, 3).round(3))
            for _ in range(1 + n % 2)
        ]
        parts.append(link(f"l{n + 1}", *boxes))
        mimic = '<mimic joint="j0" multiplier="-0.5" offset="0.2"/>' if n == 3 else ""
        limits = (
            None
            if kinds[n] == "continuous"
            else (-0.4, 0.7)
            if kinds[n] == "prismatic"
            else (-2.5, 2.0)
        )
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        at, rpy = rng.uniform(-0.6, 0.6, 3).round(3), rng.uniform(-2, 2, 3).round(3)
        parts.append(
            joint(f"j{n}", f"l{n}", f"l{n + 1}", at, axis, str(kinds[n]), limits, rpy, mimic)
        )
    return write_urdf(folder, *parts)


def random_chain(folder: Path, seed: int, count: int) -> Path:
    """Write a chain of random joints, mostly revolute, that ends in tool0, a link without geometry.

    Its links are l0, l1, ... In some chains a joint mimics the one before.
    """
    rng = np.random.default_rng(seed)
    parts, mimics = [link("l0", ((0.1, 0.1, 0.1), (0, 0, 0)))], rng.random() < 0.3
    for n in range(count):
        follows = mimics and 0 < n == count - 1
        kind = (
            "revolute"
            if follows
            else str(rng.choice(["revolute", "prismatic", "continuous"], p=(0.7, 0.15, 0.15)))
        )
        low = rng.uniform(-4.0, -1.0, 2)
        limits = (
            None
            if kind == "continuous"
            else (-0.3, 0.5)
            if kind == "prismatic"
            else (low[0], -low[1])
        )
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.7 else rng.normal(size=3)
        mimic = f'<mimic joint="j{n - 1}" multiplier="-0.5" offset="0.2"/>' if follows else ""
        at, rpy = rng.uniform(-0.4, 0.4, 3), rng.choice([0.0, np.pi / 2, -np.pi / 2, 0.4], 3)
        parts.append(link(f"l{n + 1}", ((0.05, 0.05, 0.05), (0, 0, 0))))
        parts.append(
            joint(
                f"j{n}",
                f"l{n}",
                f"l{n + 1}",
                at,
                axis / np.linalg.norm(axis),
                kind,
                limits,
                rpy,
                mimic,
            )
        )
    at, rpy = rng.uniform(-0.2, 0.2, 3), rng.uniform(-3, 3, 3)
    return write_urdf(
        folder,
        *parts,
        link("tool0"),
        joint("mount", f"l{count}", "tool0", at, kind="fixed", rpy=rpy),
    )


def draw_chain(factory: Any, seed: int, count: int) -> tuple[Any, Path, Arm]:
    """Return a generator, and a random chain in a folder of its own, as file and arm."""
    path = random_chain(factory.mktemp("chain"), seed, count)
    return np.random.default_rng(seed), path, cspace.Arm.from_urdf(path)


def pose_of(path: Path, frame: str, values: Mapping[str, Any]) -> np.ndarray:
    """Return the pose of a link in the root of a URDF, read and computed without the library.

    The values of joints are numbers, or arrays of one shape for many poses.
    """
    joints = {each.find("child").get("link"): each for each in ET.parse(path).findall("joint")}  # type: ignore[union-attr]
    pose = np.eye(4)
    while frame in joints:
        each = joints[frame]

        def numbers(tag: str, key: str, default: str = "0 0 0", each: Any = each) -> np.ndarray:
            found = each.find(tag)
            return np.array(
                (default if found is None else found.get(key, default)).split(), dtype=float
            )

        mimic, name = each.find("mimic"), each.get("name")
        value = np.asarray(values.get(str(name), 0.0))
        if mimic is not None:
            leader, factor, offset = (mimic.get(key) for key in ("joint", "multiplier", "offset"))
            value = float(factor or 1.0) * np.asarray(values.get(str(leader), 0.0)) + float(
                offset or 0.0
            )
        motion, origin = np.tile(np.eye(4), (*value.shape, 1, 1)), np.eye(4)
        if each.get("type") == "prismatic":
            motion[..., :3, 3] = value[..., None] * numbers("axis", "xyz")
        elif each.get("type") != "fixed":
            vectors = value[..., None] * numbers("axis", "xyz")
            turns = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_matrix()
            motion[..., :3, :3] = turns.reshape(*value.shape, 3, 3)
        origin[:3, 3] = numbers("origin", "xyz")
        origin[:3, :3] = Rotation.from_euler("xyz", numbers("origin", "rpy")).as_matrix()
        pose = origin @ motion @ pose
        frame = str(each.find("parent").get("link"))  # type: ignore[union-attr]
    return pose


def place_link(path: Path, arm: Arm, frame: str, q: Any) -> np.ndarray:
    """Return the poses of a link at configurations (..., dof), without the library."""
    pose = pose_of(path, frame, dict(zip(arm.joints, np.moveaxis(q, -1, 0), strict=True)))
    return np.broadcast_to(pose, (*np.shape(q)[:-1], 4, 4)).copy()


def _text(numbers: Any) -> str:
    return " ".join(str(float(number)) for number in numbers)
