"""Damaged and forged files, which open or are refused.

Separate processes, limited to 20 seconds of CPU and 2 GB, open mutants of one small file of each family:
flipped bits and bytes, swaps, truncation, extreme numbers, spliced pieces. A changed store must be
refused. A "forged" map has digests that agree with the change, as an attacker would write them.
"""

from __future__ import annotations

import inspect
import json
import multiprocessing
import re
import resource
import signal
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

import cspace
from cspace import CspaceError, Robot, Workspace
from cspace._files.formats import WORKSPACE_FORMATS
from cspace._record.save import write_folder
from tests.helpers.mesh_files import make_collada

if TYPE_CHECKING:
    from benchmarks.report import Report

SECONDS = 20
BYTES = 2**31
MUTANTS = 20_000
BATCH = 500
"""Number of mutants opened by one process."""

EXTREMES = (*b"0 -1 1e308 nan inf -0.0 4294967295 2147483648 1e-310".split(), b"9" * 19, b"9" * 400)
EXTREME_WORDS = (b"\0\0\0\0", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80")
CHANGES = ("byte", "byte", "byte", "number", "word", "cut", "splice", "repeat")

WITHOUT_END = {"box.obj", "points.csv", "points.xyz", "voxels.3dmap", "robot.yaml", "map.yaml"}
"""Families whose format does not mark the end of a file, so that truncation between lines is
undetectable."""

TRAILERS = {"image.png": 30, "image.bmp": 6}
"""Number of trailing bytes without values, such as checksums; at most two in other files."""

OF_WINGS = ("tiles", "robot.urdf", "scene.yaml", "request.yaml")
"""Families that wings read."""

AUDITED = """
import sys
from pathlib import Path
from tests.fuzz import files as fuzz

names = sorted(Path(sys.argv[1]).iterdir())
assert all(fuzz.attempt(name) == "opened" for name in names)  # imports and compiles
seen = set()
STARTS = ("socket.", "subprocess.", "os.exec", "os.fork", "os.posix_spawn", "os.system", "import")
CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate")

def audit(event, arguments):
    writes = event == "open" and (set(arguments[1] or "") & set("wax+") or (arguments[2] or 0) & 0o103)
    if event.startswith(STARTS + CHANGES) or writes:
        seen.add((event, str(arguments)[:100]))

sys.addaudithook(audit)
for name in names:
    fuzz.attempt(name)
print(sorted(seen))
"""
"""Program that opens all files of a folder, and prints what it changes or starts."""

Rng = np.random.Generator


def write_families(folder: Path) -> dict[str, Path]:
    """Write one small file of each family, those of wings too."""
    write_core_families(folder)
    joined = cspace.open(folder / "saved.zarr")
    tiles = {"store": folder / "tiles", "tile": 4}
    cspace.build(joined.workspace, joined.robot, rotations=4, **tiles).compute_components()
    solids = (
        '<box size="1 2 3"/>',
        '<cylinder radius="0.5" length="2"/>',
        '<mesh filename="box.stl" scale="1 1 0.5"/>',
    )
    parts = "".join(
        f'<collision><origin xyz="0.5 0 0" rpy="0 0.3 0"/><geometry>{solid}</geometry></collision>'
        for solid in solids
    )
    joint = '<joint name="j" type="fixed"><origin xyz="0 0 1"/><parent link="base"/><child link="top"/></joint>'
    robot = f'<robot name="r"><link name="base">{parts}</link><link name="top"/>{joint}</robot>'
    (folder / "robot.urdf").write_text(robot)
    (folder / "scene.yaml").write_text(_write_scene())
    (folder / "request.yaml").write_text(_write_request())
    return {path.name: path for path in sorted(folder.iterdir())}


def write_core_families(folder: Path) -> dict[str, Path]:
    """Write one small file of each family that the core reads."""
    import trimesh
    import zarr
    from PIL import Image

    def put(name: str, content: bytes | str) -> None:
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)

    cells = np.eye(6, 5, dtype=bool)
    plane = cspace.build(Workspace.from_array(cells, 0.1), Robot.rectangle(0.2, 0.1), rotations=4)
    Image.fromarray(np.where(cells, 0, 254).astype(np.uint8)).save(folder / "map.pgm")
    header = "image: map.pgm\nresolution: 0.1\norigin: [0.0, 0.0, 0.0]\nnegate: 0\n"
    put("map.yaml", f"{header}occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    for name in ("saved.zarr", "forged.zarr"):
        plane.save(folder / name)
    zarr.create_array(
        str(folder / "cells.zarr"), data=cells, chunks=(4, 4), config={"write_empty_chunks": True}
    )
    for suffix in ("png", "bmp", "tif", "jpg"):
        Image.fromarray(np.where(cells, 0, 255).astype(np.uint8)).save(folder / f"image.{suffix}")
    corners = [{"x": x, "y": y} for x, y in ((0.0, 0.0), (0.5, 0.0), (0.25, 0.5))]
    zone = {"zoneId": "a", "zoneType": "BLOCKED", "vertices": corners}
    put("zones.json", json.dumps({"zoneSet": {"mapId": "m", "zoneSetId": "z", "zones": [zone]}}))
    put("grid.map", "type octile\nheight 3\nwidth 4\nmap\n.@@.\n....\nT.GW\n")
    put("voxels.3dmap", "voxel 4 3 2\n0 0 0\n1 2 1\n3 0 1\n")
    shapes = [
        shapely.box(0, 0, 1, 1),
        shapely.LineString([(2, 0), (3, 1)]),
        shapely.Point(2, 2).buffer(0.3),
    ]
    put(
        "shapes.geojson",
        json.dumps(
            {"type": "GeometryCollection", "geometries": [s.__geo_interface__ for s in shapes]}
        ),
    )
    put("shapes.wkt", "\n".join(shape.wkt for shape in shapes))
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    for suffix in ("stl", "obj", "ply", "glb"):
        box.export(folder / f"box.{suffix}")
    gltf = trimesh.exchange.gltf.export_gltf(trimesh.Scene(box), embed_buffers=True)
    put("box.gltf", gltf["model.gltf"])
    put("text.stl", trimesh.exchange.stl.export_stl_ascii(box))
    put("text.ply", trimesh.exchange.ply.export_ply(box, encoding="ascii"))
    put("box.dae", make_collada())
    costmap = '  ros__parameters:\n    footprint: "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"\n    footprint_padding: 0.02\n'
    put("robot.yaml", f"local_costmap:\n{costmap}global_costmap:\n{costmap}")
    put(
        "tree.bt",
        b"# Octomap OcTree binary file\nid OcTree\nsize 24\nres 0.1\ndata\n"
        + b"\3\0" * 15
        + b"\x55\xaa",
    )
    inner, taken, free = (np.float32(value).tobytes() for value in (0.8, 0.8, -0.4))
    nodes = (inner + b"\1") * 15 + inner + b"\x11" + taken + b"\0" + free + b"\0"
    put("tree.ot", b"# Octomap OcTree file\nid OcTree\nsize 18\nres 0.1\ndata\n" + nodes)
    points = np.random.default_rng(0).random((9, 3))
    put("points.xyz", "\n".join(" ".join(map(repr, row)) for row in points.tolist()))
    put("points.csv", "\n".join(",".join(map(repr, row)) for row in points.tolist()))
    head = "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 9\nHEIGHT 1\nPOINTS 9\nDATA "
    put("points.pcd", f"{head}binary\n".encode() + points.astype("<f4").tobytes())
    np.save(folder / "points.npy", points)
    np.save(folder / "cells.npy", cells)
    return {path.name: path for path in sorted(folder.iterdir())}


POSE = {"position": [0.1, 0, 0.5], "orientation": {"x": 0, "y": 0, "z": 0.6, "w": 0.8}}


def _write_scene() -> str:
    """Write a planning scene with all that one may have, as JSON, which is YAML."""
    kinds = {"box": [1, 2, 3], "sphere": [0.5], "cylinder": [2, 0.5], "cone": [2, 0.5]}
    vertices, triangles = np.eye(4, 3, -1).tolist(), [[0, 2, 1], [0, 1, 3], [1, 2, 3]]
    mesh = {"vertices": vertices, "triangles": triangles}
    one = {
        "id": "all",
        "header": {"frame_id": "shelf"},
        "pose": POSE,
        "primitives": [{"type": kind, "dimensions": sizes} for kind, sizes in kinds.items()],
        "primitive_poses": [POSE] * 4,
        "meshes": [mesh, {"resource": "box.stl", "dimensions": [1, 1, 0.5]}],
        "mesh_poses": [POSE] * 2,
    }
    mug = {"primitives": [{"type": 2, "dimensions": [0.1]}], "primitive_poses": [POSE]}
    mug |= {"id": "mug", "header": {"frame_id": "tool"}}
    shelf = {"header": {"frame_id": "shelf"}, "child_frame_id": "world"}
    still = {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1]}
    attached = {"link_name": "tool", "object": mug, "touch_links": ["hand"]}
    allowed = {"entry_names": ["a", "b"], "entry_values": [[False, True], [True, False]]}
    scene = {
        "world": {"collision_objects": [one]},
        "fixed_frame_transforms": [shelf | {"transform": still}],
        "robot_state": {**STATE, "attached_collision_objects": [attached]},
        "allowed_collision_matrix": allowed,
        "link_padding": [{"link_name": "tool", "padding": 0.0}],
    }
    return json.dumps(scene)


STATE = {"joint_state": {"name": ["a", "b"], "position": [0.5, 1]}}


def _write_request() -> str:
    """Write a motion plan request with goals of each kind, as JSON, which is YAML."""
    head = {"header": {"frame_id": "base"}, "link_name": "tool", "weight": 1}
    region = {"primitives": [{"type": "box", "dimensions": [1, 2, 3]}], "primitive_poses": [POSE]}
    position = {"constraint_region": region, "target_point_offset": [0, 0, 0]}
    tolerances = {f"absolute_{axis}_axis_tolerance": 0.1 for axis in "xyz"}
    pose = {
        "position_constraints": [head | position],
        "orientation_constraints": [{**head, "orientation": [0, 0.6, 0, 0.8], **tolerances}],
    }
    joint = {"joint_name": "a", "position": 1, "weight": 1}
    joint |= {"tolerance_above": 0.1, "tolerance_below": 0.2}
    request = {"group_name": "arm", "start_state": STATE, "allowed_planning_time": 5}
    return json.dumps(request | {"goal_constraints": [{"joint_constraints": [joint]}, pose]})


def open_file(path: Path) -> object:
    """Open a file like a user."""
    if path.stem in OPENERS:
        return OPENERS[path.stem](path)
    path = path.with_name("map.yaml") if path.name == "map.pgm" else path
    reader = getattr(Workspace, WORKSPACE_FORMATS[path.suffix].method)
    options: dict[str, Any] = {}
    if "spacing" in inspect.signature(reader).parameters:
        options["spacing"] = 0.5
    if path.suffix in (".glb", ".gltf", ".dae"):
        options["up"] = "y"
    return Workspace.open(path, **options).outer


def _use_map(path: Path) -> object:
    """Query an opened map, which must answer if it has opened."""
    space: Any = cspace.open(path)
    q = np.random.default_rng(0).uniform(-1.0, 2.0, (30, space.size))
    space.motion_is_free(q[0], q), space.clearance(q), space.is_disconnected(q[0], q)
    return (space.exact if isinstance(space, cspace.CSpace) else space).is_free(q[:5])


OPENERS: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(("saved", "forged", "tiles"), _use_map),
    "robot": Robot.open,
    "scene": lambda path: cspace.arms.read_moveit_scene(path),
    "request": lambda path: cspace.arms.read_moveit_request(path),
}


def mutate(content: bytes, other: bytes, rng: Rng) -> bytes:
    """Change a file one to four times.

    ``other`` is a file to splice pieces from.
    """
    data = bytearray(content)
    for _ in range(int(rng.integers(1, 5))):
        data = _change(str(rng.choice(CHANGES)), data, other, rng)
    return bytes(data)


def _change(kind: str, data: bytearray, other: bytes, rng: Rng) -> bytearray:
    at = int(rng.integers(len(data) + 1))
    if kind == "cut":
        return data[:at]
    if kind == "splice":  # insert a piece of another file, or of this one, often over bytes
        source = other if rng.random() < 0.5 else bytes(data)
        start, drop = int(rng.integers(len(source) + 1)), int(rng.choice([0, 64]))
        return data[:at] + source[start : start + int(rng.integers(1, 65))] + data[at + drop :]
    if kind == "repeat":  # makes deep nesting and long lines
        return data[:at] + data[at : at + 1] * int(rng.integers(2, 20_000)) + data[at:]
    if kind == "number":
        numbers = list(re.finditer(rb"-?\d+(\.\d+)?", data))
        if numbers:
            first, stop = numbers[int(rng.integers(len(numbers)))].span()
            data[first:stop] = EXTREMES[int(rng.integers(len(EXTREMES)))]
    elif kind == "word":
        data[at : at + 4] = EXTREME_WORDS[int(rng.integers(len(EXTREME_WORDS)))]
    elif at < len(data):
        data[at] ^= int(rng.choice([1 << int(rng.integers(8)), int(rng.integers(1, 256))]))
    return data


def attempt(path: Path) -> str:
    """Open a file; return "opened", "refused", or the failure."""
    try:
        with warnings.catch_warnings(action="ignore"):
            open_file(path)
    except CspaceError as error:
        return "refused" if "\n" not in str(error) else f"several lines: {str(error)[:200]!r}"
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:100]!r} at {Path(where.filename).name}:{where.lineno}"
    return "opened"


def count_outcomes(
    seed: int, every: dict[str, Path], name: str, first: int, count: int, keep: Path | None = None
) -> Counter[str]:
    """Count outcomes of mutants of a family, and restore its file.

    Failing mutants are written to ``keep``.
    """
    outcomes: Counter[str] = Counter()
    signal.signal(signal.SIGPROF, _late)  # CPU, not the clock
    # Python calls `_late` between its own steps only, so a loop in a library is killed later.
    signal.signal(signal.SIGVTALRM, signal.SIG_DFL)
    path, write = every[name], _FORGERS.get(name, _write)
    parts = read_parts(path)
    others = [other.read_bytes() for other in every.values() if other.is_file()]
    for number in range(first, first + count):
        rng = np.random.default_rng([seed, sum(name.encode()), number])
        part = sorted(parts)[int(rng.integers(len(parts)))]
        changed = mutate(parts[part], others[int(rng.integers(len(others)))], rng)
        write(path, parts, part, changed)
        start = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        signal.setitimer(signal.ITIMER_VIRTUAL, 2 * SECONDS)
        result = attempt(path)
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        if time.process_time() - start > SECONDS:
            result = f"over {SECONDS} s, then {result}"
        if name == "saved.zarr" and result == "opened" and changed != parts[part]:
            result = "a changed store was opened"
        if result not in ("opened", "refused"):
            result = f"{name} {number}: {result}"
            if keep is not None:
                (keep / f"{number}-{Path(part or name).name}").write_bytes(changed)
        outcomes[result] += 1
        write(path, parts, part, parts[part])
    return outcomes


def open_cut_files(every: dict[str, Path], count: int) -> list[tuple[str, int]]:
    """Return name and length of each cut file that opens although its format marks its end."""
    opened = []
    for name, path in every.items():
        if path.is_dir() or name in WITHOUT_END:
            continue
        content = path.read_bytes()
        lengths = np.linspace(0, len(content) - TRAILERS.get(name, 3), count).astype(int)
        for length in lengths.tolist():
            path.write_bytes(content[:length])
            if attempt(path) != "refused":
                opened.append((name, length))
        path.write_bytes(content)
    return opened


Parts = dict[str, bytes]
"""Contents of the files of a folder, by name."""


def read_parts(path: Path) -> Parts:
    if path.is_dir():
        return {
            part.relative_to(path).as_posix(): part.read_bytes()
            for part in path.rglob("*")
            if part.is_file()
        }
    return {"": path.read_bytes()}


def _write(path: Path, parts: Parts, part: str, content: bytes) -> None:
    (path / part).unlink(missing_ok=True)  # disks overwrite files slowly
    (path / part).write_bytes(content)


def forge_store(path: Path, parts: Parts, part: str, content: bytes) -> None:
    """Write one part of a stored map, and matching digests."""
    _write(path, parts, part, content)
    with suppress(Exception):  # damaged metadata may not decode
        reseal(path)


def reseal(path: Path, **changes: Any) -> None:
    """Change attributes of a saved map, and write the digest of what its folder holds now."""
    attributes = json.loads((path / "zarr.json").read_bytes())["attributes"] | changes
    del attributes["digest"]
    names = []
    for name in attributes.get("arrays", "").split():
        chunks = [file.name for file in (path / name).glob("c.*")]
        chunks.sort(key=lambda chunk: [int(part) for part in chunk.split(".")[1:]])
        names += [f"{name}/{file}" for file in ("zarr.json", *chunks)]
    there = [name for name in names if (path / name).is_file()]
    write_folder(path, attributes, [(name, (path / name).read_bytes()) for name in there])


_FORGERS = {"forged.zarr": forge_store}


class Late(BaseException):
    """Opening took too long; a BaseException that only fuzzing catches."""


def _late(*about: object) -> None:
    raise Late


def _child(results: Any, *arguments: Any) -> None:
    statm = Path("/proc/self/statm")
    used = int(statm.read_text().split()[0]) * resource.getpagesize() if statm.exists() else 0
    resource.setrlimit(resource.RLIMIT_AS, (used + BYTES, used + BYTES))
    results.send(count_outcomes(*arguments))


def _count_in_children(seed: int, every: dict[str, Path], name: str, wanted: int) -> Counter[str]:
    """Count outcomes of mutants in child processes."""
    outcomes: Counter[str] = Counter()
    opened = attempt(every[name])  # imports and compiles for the children, too
    if opened != "opened":
        outcomes[f"{name} itself: {opened}"] += 1
    context = multiprocessing.get_context("fork")
    for first in range(0, wanted, BATCH):
        results, end = context.Pipe(duplex=False)
        child = context.Process(
            target=_child, args=(end, seed, every, name, first, min(BATCH, wanted - first))
        )
        child.start()
        end.close()  # so that reading ends when the child dies
        try:
            outcomes += results.recv()
        except EOFError:  # the child died, and left its mutant behind
            outcomes[f"{name}: a process died among mutants {first} to {first + BATCH}"] += 1
            break
        finally:
            child.join()
            results.close()
    return outcomes


def check(report: Report, seed: int, wanted: int = MUTANTS) -> None:
    """Check mutants of every family."""
    report.section(
        f"files: {wanted} mutants of each family, seed {seed}, {SECONDS} s and {BYTES / 2**30:g} GB each"
    )
    with tempfile.TemporaryDirectory() as folder:
        every = write_families(Path(folder))
        names = list(every)
        report.check(not open_cut_files(every, 100), "files: cut files are refused")
    for name in names:
        start = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            outcomes = _count_in_children(seed, write_families(Path(folder)), name, wanted)
        bad = [result for result in outcomes if result not in ("opened", "refused")]
        opened, refused = outcomes["opened"], outcomes["refused"]
        report.note(
            f"{name}: {opened} opened, {refused} refused, {time.perf_counter() - start:.0f} s"
        )
        for result in bad[:9]:
            report.note(f"  {result}")
        report.check(not bad, f"{name}: every mutant opens or is refused in one line")
