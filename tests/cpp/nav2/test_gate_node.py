"""The gate node drives as its messages say, over stubs of ROS 2, and refuses parameters that cannot be."""

import os
import re
import sys
import time

import numpy as np
import pytest

import cspace
from tests.helpers.cpp import SANITIZERS, Program, build_program, why_no_compiler
from tests.helpers.messages import make_grid
from tests.helpers.nav2 import ANSWERS, PACKAGE, list_stubs
from tests.helpers.waiting import until

pytestmark = pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler())

FREE = " ".join(["inf"] * 36)
SIDES = "[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]"


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    target = tmp_path_factory.mktemp("program") / "node"
    folders = [f"-I{name}" for name in (PACKAGE / "include", *list_stubs("jazzy"))]
    flags = ("-O1", *SANITIZERS, "-fno-sanitize-recover=all", *folders)
    return build_program(target, *flags, source=ANSWERS / "gate_node.cpp")


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Save the map of a room that is 6 m x 4 m, with yaw, without, and of another frame."""
    folder = tmp_path_factory.mktemp("maps")
    cells = np.zeros((60, 40), dtype=bool)
    cells[[0, -1]] = cells[:, [0, -1]] = True
    workspace = cspace.Workspace.from_array(cells, 0.1)
    robot = cspace.Robot.rectangle(0.6, 0.4)
    cspace.build(workspace, robot, rotations=36).save(folder / "room")
    cspace.build(workspace, robot).save(folder / "flat")
    scene = np.repeat(cells[:, :, np.newaxis], 6, axis=2)
    scene[:, :, 4:] = True  # a ceiling
    box = cspace.Robot.box((0.6, 0.4, 0.3), (0.0, 0.0, 0.2))
    scene = cspace.Workspace.from_array(scene, 0.1)
    cspace.build(scene, box, rotations=36, floor=0.01).save(folder / "floor")
    hall = cspace.Workspace.from_occupancy_grid(make_grid("hall"))
    cspace.build(hall, robot, rotations=4).save(folder / "hall")
    return folder


class Node(Program):
    """A node of a running program."""

    def __init__(self, program, log, **parameters):
        """Start the node."""
        super().__init__([program], log)
        for name, value in parameters.items():
            self.tell("set", name, value)
        self.tell("start")

    def ask(self, *words):
        """Send a line and return the answer."""
        self.tell(*words)
        return self.read_line()

    def activate(self):
        """Configure and activate the node."""
        assert [self.ask("configure"), self.ask("activate")] == ["success", "success"]

    def leave(self, way):
        """Deactivate the node, or shut it down; return what it publishes until it rests."""
        self.tell(way)
        return list(iter(self.read_line, "success"))

    def cycle(self, command="command 0.6 0.0", scan=f"laser {FREE}"):
        """Go on by a cycle; return what is published."""
        if command:
            self.tell(command)
        if scan:
            self.tell("scan", scan)
        kind, *words = self.ask("cycle").split()
        assert self.read_line() == "."
        return tuple(map(float, words)) if kind == "twist" else (kind, *words)

    def end(self):
        """Send SIGTERM; return what is published from then on."""
        self.tell("end")
        return self.close().splitlines()


@pytest.fixture
def start(program, maps, tmp_path):
    """Return a function that starts a node in the room."""
    nodes = []

    def start(**parameters):
        options = {"map": maps / "room", "leaving": "true", **parameters}
        nodes.append(Node(program, tmp_path / f"log{len(nodes)}", **options))
        nodes[-1].tell("place 3.0 2.0")
        return nodes[-1]

    yield start
    for node in nodes:
        node.close()


@pytest.fixture
def node(start):
    """Return a node that drives."""
    node = start()
    node.activate()
    node.cycle()
    assert node.cycle() == (0.6, 0.0)
    return node


def test_it_drives_and_brakes_as_told(node):
    assert node.cycle("command 0.5 0.1") == (0.55, 0.0)
    assert node.cycle("command 0.5 0.1") == (0.5, 0.1)
    node.tell("place 5.4 2.0")
    assert node.cycle()[0] < 0.5  # the pose jumped, to before a wall
    assert "stops: the pose jumped" in node.read_log()


@pytest.mark.parametrize(
    "scan, reason",
    [
        ("laser", "'scan': a scan has no ray that was measured"),
        ("laser nan nan", "'scan': a scan has no ray that was measured"),
        ("camera inf", '"camera" does not exist'),
        ("odom inf", "the laser of 'scan' is not between min_height and max_height"),
    ],
)
def test_it_brakes_within_a_period_and_says_why(node, scan, reason):
    assert node.cycle(scan=scan) == (0.55, 0.0)
    assert f"[WARN] [cspace_gate]: stops: {reason}" in node.read_log()
    node.cycle()
    assert node.read_log().endswith("drives\n") and node.cycle() == (0.6, 0.0)


@pytest.mark.parametrize(
    "command, reason",
    [
        ("command nan 0", "is not finite"),
        ("command 0 inf", "is not finite"),
        ("sideways 0.1 0.6", "goes sideways, and the parameter 'holonomic' is false"),
        ("command 1.01 0", "is faster than max_velocity"),
        ("command 0.1 -30", "is faster than max_velocity"),
    ],
)
def test_it_brakes_on_commands_that_it_cannot_prove(node, command, reason):
    assert node.cycle(command) == (0.55, 0.0)
    assert f"a command {reason}" in node.read_log()


def test_the_largest_velocity_is_a_parameter(start):
    node = start(max_velocity="0.5|1.0")
    node.activate()
    for command, passes in (("0.55 0", False), ("0 1.1", False), ("0.5 0", True)):
        node.cycle(f"command {command}")
        assert any(node.cycle(f"command {command}")) == passes
    assert node.ask("param max_velocity 0.6|1.0") == "."
    node.cycle()
    assert any(node.cycle("command 0.6 0"))


def test_it_is_configured_after_a_refused_parameter_was_set(start):
    node = start(robot="nonsense")
    assert node.ask("configure") == "failure" and node.ask("param robot disc:0.3") == "."
    assert node.ask("configure") == "success"
    assert "'robot' is read when the node is configured" in node.ask("param robot disc:0.2")


@pytest.mark.parametrize(
    "value, reason",
    [
        ("1.8|1.8|0.02", ""),
        ("0.1", "'tracking' has 1 numbers"),
        ("-1|0|0", "'tracking' is -1"),
    ],
)
def test_margins_may_change_while_it_drives(node, value, reason):
    assert node.ask(f"param tracking {value}") == "."
    assert node.cycle() == (0.55, 0.0)
    assert reason in node.read_log()
    assert node.ask("param tracking 0.01|0.01|0.01") == "."
    node.cycle()
    assert node.cycle() == (0.6, 0.0)


@pytest.mark.parametrize(
    "command, reason",
    [("sideways 0.81 0.6", "is faster than max_velocity"), ("sideways nan 0.6", "is not finite")],
)
def test_a_holonomic_robot_drives_sideways_and_comes_to_rest(start, command, reason):
    node = start(holonomic="true")
    node.activate()
    node.cycle("sideways 0.6 0.3")
    assert node.cycle("sideways 0.6 0.3") == (0.3, 0.0, 0.6)
    node.cycle(command)
    assert f"a command {reason}" in node.read_log()
    node.cycle("sideways 0.4 0")
    driven = [node.cycle("sideways 0.4 0") for _ in range(16)]
    assert driven[-1] == (0.0, 0.0, 0.4)
    lines = [list(map(float, line.split()[1:])) for line in node.end()]
    sides = [side for _, _, side in lines[:-1]]
    np.testing.assert_allclose(-np.diff([0.4, *sides, 0.0]), 0.05)
    assert lines[-1] == [0.0, 0.0]


def test_another_publisher_of_commands_is_named_and_nothing_is_sent_beside_it(node):
    node.tell("rival cspace_gate collision_monitor")
    assert node.cycle() == (0.55, 0.0)
    assert "stops: the node 'collision_monitor' publishes cmd_vel, too" in node.read_log()
    for others in ("other/cspace_gate", "cspace_gate cspace_gate"):  # the same launch, twice
        node.tell("rival cspace_gate")
        node.cycle()
        assert node.cycle() == (0.6, 0.0)
        node.tell(f"rival {others}")
        assert node.cycle() == (0.55, 0.0)
    node.leave("deactivate")
    for rival in ("collision_monitor", "cspace_gate"):
        node.tell(f"rival {rival}")
        assert node.ask("activate") == "failure"


def test_clouds_alone_are_enough(start):
    node = start(clouds="depth")
    node.activate()
    for _ in range(2):
        node.cycle(scan="")
    assert "no scan of 'depth' within" in node.read_log()
    for _ in range(2):
        node.tell("cloud depth 2.0 0.0 0.0")
        driven = node.cycle(scan="")
    assert driven == (0.6, 0.0)
    node.tell("cloud depth 0.5 0.0 0.0")
    assert node.cycle(scan="") == (0.55, 0.0)


@pytest.mark.parametrize("place", ["13.0 2.0", "3.0 5.5", "0.05 2.0"])
def test_a_robot_that_is_lost_stands_and_says_so(start, place):
    node = start()
    node.tell(f"place {place}")
    node.activate()
    for command in ("0.6 0", "-0.6 0", "0 1"):
        node.cycle(f"command {command}")
        assert node.cycle(f"command {command}") == (0.0, 0.0)
    assert "the robot is lost" in node.read_log()


def test_stamped_commands_count_by_their_stamp_and_stamped_ones_are_sent(start):
    node = start(stamped="true", base_frame="base_link")
    node.activate()
    for _ in range(2):
        kind, seconds, frame, *twist = node.cycle("stamped 0.6 0.0 0.2")
    assert (kind, frame, twist) == ("stamped", "base_link", ["twist", "0.6", "0"])
    assert float(seconds) == 1.7e9
    for age in (0.5, -0.5):
        assert node.cycle(f"stamped 0.6 0.0 {age}")[-2] == "0.55"
        assert node.read_log().endswith("no command within 0.3 s\n")
        for _ in range(2):
            node.cycle("stamped 0.6 0.0 0.2")


@pytest.mark.parametrize("name", ["room", "floor"])
def test_it_slowly_leaves_a_wall_that_it_is_too_near_to(start, maps, name):
    for leaving, speed in (("true", 0.1), ("false", 0.0)):
        node = start(map=maps / name, leaving=leaving)
        node.tell("place 0.45 2.0")  # 5 cm from the wall behind
        node.activate()
        node.cycle()
        assert node.cycle() == (speed, 0.0), node.read_log()


@pytest.mark.parametrize("way", ["deactivate", "shutdown", "end"])
def test_it_comes_to_rest_before_it_goes(node, way):
    lines = node.end() if way == "end" else node.leave(way)
    speeds = [float(line.split()[1]) for line in lines]
    assert len(speeds) == 12 and speeds[-1] == 0.0
    np.testing.assert_allclose(-np.diff([0.6, *speeds]), 0.05)


def test_it_can_be_configured_anew(node):
    node.cycle("command 0 0")
    for _ in range(12):
        node.cycle("command 0 0")
    node.leave("deactivate")
    assert node.ask("cleanup") == "success"
    node.activate()
    node.cycle()
    assert node.cycle() == (0.6, 0.0)


@pytest.mark.parametrize(
    "parameters, message",
    [
        ({"map": ""}, "the parameters 'map' and 'robot' are missing"),
        ({"map": "", "robot": "disc:0.3", "rotations": "0"}, "'rotations' is 0; it must be from 1"),
        ({"map": "", "robot": "disc:0.3", "map_folder": ""}, "'map_folder' is empty"),
        ({"map": "/nowhere"}, "/nowhere/zarr.json"),
        ({"map": "flat"}, "leaving' needs a map of x, y and yaw"),
        ({"map": "flat", "leaving": "false"}, "a gate needs a map of x, y and yaw"),
        ({"map": "hall"}, "the parameter 'map_frame' is 'map'; the map is in 'hall'"),
        ({"footprint": SIDES.replace("0.3", "0.31")}, "not the robot that the map was built for"),
        ({"footprint": "0.3"}, "no list of pairs"),
        ({"max_deceleration": "1.0"}, "'max_deceleration' has 1 numbers; it must have 2"),
        ({"max_deceleration": "0.0|1.0"}, "'max_deceleration' is 0.000000; it must be from 0.001"),
        ({"tracking": "0.1|0.1"}, "'tracking' has 2 numbers; it must have 3"),
        ({"tracking": "0.1|0.1|-1"}, "'tracking' is -1.000000; it must be from 0"),
        ({"map": "", "robot": "disc:0.3", "footprint": "0.3"}, "no list of pairs"),
        ({"max_age": "0.02"}, "'max_age' is below 'period'"),
        ({"min_height": "2.5"}, "'min_height' must be below 'max_height'"),
        ({"scans": ""}, "name no topic"),
        ({"period": 0.6}, "'period' is not in its range"),
        ({"period": 0.0}, "'period' is not in its range"),
        ({"max_tilt": 1.0}, "'max_tilt' is not in its range"),
        ({"scans": "bad topic"}, "'bad topic'"),
        ({"scans": "scan|3d"}, "'3d'"),
        ({"clouds": "depth|/depth"}, "name '/depth' twice"),
        ({"robot": "nonsense"}, "'robot' is 'nonsense'; it must be disc:RADIUS, or footprint:"),
        ({"robot": "disc:-1"}, "'robot' is 'disc:-1'; it must be"),
        ({"robot": "disc:1e9"}, "metres, at most 100 from the origin"),
        ({"robot": "disc:0.3 m"}, "'robot' is 'disc:0.3 m'"),
        ({"robot": "footprint:[[0.3, 0.2], [-0.3, 0.2]]"}, "'robot' is 'footprint:[[0.3, 0.2]"),
        ({"robot": "footprint:[[0, 0], [1, 1], [1, 0], [0, 1]]"}, "a convex polygon"),
    ],
)
def test_parameters_that_cannot_be_are_refused_when_configured(start, maps, parameters, message):
    if parameters.get("map") in ("flat", "hall"):
        parameters = {**parameters, "map": maps / parameters["map"]}
    node = start(**parameters)
    assert node.ask("configure") == "failure"
    assert message in node.read_log()


# ---- the map of the topic ------------------------------------------------------------------------


@pytest.fixture
def follow(start, builder, tmp_path):
    """Return a function that starts a node on the topic of grids."""

    def follow(**parameters):
        options = {"map": "", "robot": f"footprint:{SIDES}", "rotations": 36, "builder": builder}
        node = start(map_folder=tmp_path / "maps", **{**options, **parameters})
        node.activate()
        return node

    return follow


def cycle_until(node, pattern, command="command 0.6 0.0"):
    """Go on by cycles until the last line of the log has a pattern; return what is driven."""
    commands = []
    while not re.search(pattern, (node.read_log().splitlines() or [""])[-1]):
        time.sleep(0.02)
        commands.append(node.cycle(command))
        assert len(commands) < 30_000, node.read_log()
    return commands


def test_it_drives_on_the_map_of_the_topic_and_brakes_where_a_new_one_has_changed(follow, tmp_path):
    node = follow()
    assert node.cycle() == (0.0, 0.0) and "stops: no map has come" in node.read_log()
    node.tell("grid map 0")
    commands = cycle_until(node, "drives")
    assert not np.any(commands[:-1]) and "stops: the map is being built" in node.read_log()
    node.tell("grid map 0")
    assert node.cycle() == (0.6, 0.0)
    node.tell("grid map 35")  # a wall within the way that it needs to stop
    speeds = [node.cycle()[0] for _ in range(12)]
    np.testing.assert_allclose(-np.diff([0.6, *speeds]), 0.05)
    assert "stops: the map has changed near the robot" in node.read_log()
    node.tell("place 3.18 2.0")  # 2 cm before the wall
    cycle_until(node, "no part of the command is proven free")
    assert len((tmp_path / "calls").read_text()) == 2
    again = follow(builder="/no/cspace")
    again.tell("grid map 35")
    cycle_until(again, "drives")


@pytest.mark.parametrize("before, after", [(0, 50), (50, 0)])
def test_it_drives_on_while_a_map_is_built_that_has_changed_far_away(follow, before, after):
    node = follow()
    node.tell(f"grid map {before}")
    cycle_until(node, "drives")
    node.cycle()
    node.tell(f"grid map {after}")
    assert set(cycle_until(node, "the map is ready")[1:]) == {(0.6, 0.0)}
    node.tell("place 4.68 2.0")  # 2 cm before where the wall is, or was
    cycle_until(node, "no part of the command is proven free" if after else "drives")


def test_it_drives_on_while_a_map_is_built_in_which_a_wall_nearby_has_gone(follow):
    node, back = follow(), "command -0.6 0.0"
    node.tell("grid map 36")
    cycle_until(node, "drives", back)
    node.cycle(back)
    node.tell("grid map 0")
    assert set(cycle_until(node, "the map is ready|stops", back)[1:]) == {(-0.6, 0.0)}


@pytest.mark.parametrize(
    "before, grown, reason",
    [
        pytest.param("36", "36 7", "", id="larger"),
        pytest.param("43", "36 7", "has changed near the robot", id="larger, another wall"),
        pytest.param("43 7", "36", "has changed near the robot", id="smaller, another wall"),
        pytest.param("0", "0 -40", "has changed near the robot", id="smaller, without its place"),
        pytest.param("0", "0 -25", "has changed near the robot", id="smaller, ends beside it"),
        pytest.param("0", "0 -20", "", id="smaller, beyond its reach"),
        pytest.param("0", "0 0.5", "is being built", id="moved by half a cell"),
        pytest.param("0", "0 0 0.2", "is being built", id="larger cells"),
    ],
)
def test_a_grid_that_has_grown_is_compared_cell_by_cell(follow, before, grown, reason):
    node, back = follow(), "command -0.6 0.0"
    node.tell(f"grid map {before}")
    cycle_until(node, "drives", back)
    node.cycle(back)
    node.tell(f"grid map {grown}")
    assert node.cycle(back) == ((-0.55 if reason else -0.6), 0.0)
    assert not reason or f"stops: the map {reason}" in node.read_log()


def test_a_build_ends_although_a_newer_grid_comes(follow, write_script, tmp_path):
    script = write_script(
        f"mkdir {tmp_path}/first || exec sleep 600\n"
        f"while [ ! -e {tmp_path}/newer ]; do sleep 0.1; done\n"
        f'exec {sys.executable} -m cspace "$@"'
    )
    node = follow(builder=script)
    node.tell("grid map 0")
    until((tmp_path / "first").exists)
    node.tell("grid map 50")
    node.cycle()
    (tmp_path / "newer").touch()
    cycle_until(node, "drives")
    node.tell("place 4.5 2.0")
    cycle_until(node, "the map has changed near the robot")


@pytest.mark.parametrize(
    "parameters, grid, message",
    [
        ({"map_frame": "world"}, "map 0", "the map is in 'map', not in 'world'"),
        ({}, '"" 0', "the map is in '', not in 'map'"),
        (
            {},
            "map 0 0 0.1 0",
            "the map's origin is none: its quaternion (x, y, z, w) is (0, 0, 0, 0)",
        ),
        ({"builder": "/no/cspace"}, "map 0", "the command '/no/cspace' does not start"),
        ({"builder": "false"}, "map 0", "build' failed: "),
        (
            {"footprint": SIDES.replace("0.3", "0.31")},
            "map 0",
            "not the robot that the map was built",
        ),
    ],
)
def test_it_stands_and_says_why_there_is_no_gate(follow, parameters, grid, message):
    node = follow(**parameters)
    node.tell(f"grid {grid}")
    assert not np.any(cycle_until(node, f"stops: .*{re.escape(message)}"))
    lines = node.read_log().splitlines()
    assert len(lines) == len(set(lines)) < 6


def test_a_map_that_another_process_has_kept_meanwhile_stays(follow, write_script, tmp_path):
    script = write_script(
        f'{sys.executable} -m cspace "$@" || exit 1\n'
        f"part=$(echo {tmp_path}/maps/*.part)\nkept=${{part%%.*.part}}\n"
        'cp -r "$part" "$kept"\ntouch "$kept/other"'
    )
    node = follow(builder=script)
    node.tell("grid map 0")
    cycle_until(node, "drives")
    (kept,) = (tmp_path / "maps").iterdir()
    assert (kept / "other").exists()


FILES = ("map.pgm", "map.yaml", "robot", "options")
"""Files beside a kept map, which say what it is of."""


def make_folders(maps, *names, files=FILES):
    """Make folders that are older than a map, the first ones the oldest; return them."""
    folders = [maps / name for name in names]
    for seconds, folder in enumerate(folders):
        folder.mkdir(parents=True)
        for name in files:
            (folder / name).write_text("years of work")
        os.utime(folder, (seconds, seconds))
    return folders


def test_only_old_maps_and_killed_builds_leave_the_folder(follow, tmp_path):
    maps = tmp_path / "maps"
    digits = [f"{number:016x}" for number in range(0xABCD, 0xABCD + 30)]
    kept = make_folders(maps, *(f"project {number}" for number in range(12)))
    kept += make_folders(maps, digits[20], digits[20][1:], f"{digits[20]}0", files=FILES[1:])
    kept += make_folders(maps, digits[21][1:], digits[22].upper(), f"{digits[23]}.old")
    kept += make_folders(maps, digits[24], f"{digits[25]}.1.part", files=(*FILES, "notes"))
    kept += make_folders(maps, "notes.part", f"{digits[26][1:]}.1.part", files=FILES)
    (maps / digits[27]).symlink_to(*make_folders(tmp_path, "elsewhere"))
    (maps / digits[28]).write_text("years of work")
    gone = make_folders(maps, f"{digits[29]}.1.part", f"{digits[29]}.7134.part")
    gone += make_folders(maps, f"{digits[29]}.2.part", files=(*FILES[:3], ".cspace-12.zarr"))
    *old, newest = make_folders(maps, *digits[:9], files=(*FILES, "log", "map.zarr"))
    node = follow()
    node.tell("grid map 0")
    cycle_until(node, "drives")
    assert all(folder.exists() for folder in [*kept, *old[2:], newest])
    assert not any(folder.exists() for folder in [*gone, *old[:2]])
    assert len(list((tmp_path / "elsewhere").iterdir())) == 4
    assert (maps / digits[27]).is_symlink() and (maps / digits[28]).is_file()


@pytest.mark.parametrize("name", ["notes", "options"])
def test_what_is_in_the_way_of_a_map_is_no_map_and_stays(follow, tmp_path, name):
    """A folder that has the name of a map holds something else, or lacks a file."""
    node = follow()
    node.tell("grid map 0")
    cycle_until(node, "drives")
    (kept,) = (tmp_path / "maps").iterdir()
    if name == "notes":
        (kept / "map.zarr" / "zarr.json").unlink()
        (kept / name).write_text("years of work")
    else:
        (kept / name).unlink()
    before = sorted(kept.rglob("*"))
    again = follow()
    again.tell("grid map 0")
    cycle_until(again, f"stops: there is no map: .*{kept.name} holds more or less than a map")
    assert sorted(kept.rglob("*")) == before
    assert list((tmp_path / "maps").iterdir()) == [kept]


def test_builds_at_once_keep_out_of_each_others_way(follow, program, write_script, tmp_path):
    """The folder of a build stays while its node lives, and goes after the node was killed."""
    script = write_script(f"touch {tmp_path}/started\nexec sleep 600")
    options = {"map": "", "robot": f"footprint:{SIDES}", "rotations": 36, "builder": script}
    slow = Node(program, tmp_path / "log", map_folder=tmp_path / "maps", **options)
    slow.ask("configure")
    slow.tell("grid map 0")
    until((tmp_path / "started").exists)
    (part,) = (tmp_path / "maps").iterdir()
    for wall in (0, 40):
        node = follow()
        node.tell(f"grid map {wall}")
        cycle_until(node, "drives")
        assert part.exists() and len(list((tmp_path / "maps").glob("*.part"))) == 1
    slow.process.kill()
    slow.process.wait()
    node.tell("grid map 50")
    cycle_until(node, "the map is ready")
    assert not part.exists() and len(list((tmp_path / "maps").iterdir())) == 3


def test_each_parameter_is_described(start):
    node = start()
    node.ask("configure")
    lines = [node.ask("rules")]
    while lines[-1] != ".":
        lines.append(node.read_line())
    sources = (PACKAGE / "src/gate_node.cpp", PACKAGE / "include/cspace_nav2/map_maker.hpp")
    text = "".join(source.read_text() for source in sources)
    names = re.findall(r'parameters\.\w+\("(\w+)"', text)
    assert sorted(names) == [re.split(r"[ :]", line)[0] for line in lines[:-1]]
    assert all(len(line.split(": ")[1]) > 10 for line in lines[:-1])
