"""Planning problems for arms, and the peers pinocchio with coal, and VAMP."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cspace import Arm, Robot, build_arm_space
from cspace._support.arrays import Floats
from cspace.arms import ArmSpace, PosedShape

OMPL_RESOLUTION = 0.01
"""Largest step that OMPL checks by default, as a share of the extent of the space."""

COAL_TOLERANCE = 1e-6
"""Largest distance at which coal calls bodies colliding, metres."""


@dataclass(frozen=True)
class Folder:
    """A robot's URDF, SRDF and problems.

    Attributes
    ----------
    path : Path
        Folder with the robot's name.
    """

    path: Path

    @property
    def robot(self) -> str:
        return self.path.name

    @property
    def urdf(self) -> Path:
        return self.path / f"{self.robot}.urdf"

    @property
    def srdf(self) -> Path:
        return self.path / f"{self.robot}.srdf"

    @cached_property
    def arm(self) -> Arm:
        return Arm.from_urdf(self.urdf, self.srdf)

    def problems(self, number: int) -> Iterator[ArmProblem]:
        """Yield a number of problems of each set, evenly spaced."""
        listed = json.loads((self.path / "problems.json").read_text(encoding="utf-8"))
        order = [listed["joints"].index(name) for name in self.arm.joints]
        for name, problems in listed["problems"].items():
            for row in problems[:: max(1, len(problems) // number)][:number]:
                # Configurations at a limit may exceed it, because files round them.
                endpoints = np.array([row["start"], *row["goals"]])[:, order].clip(
                    self.arm.lower, self.arm.upper
                )
                yield ArmProblem(self, name, row, endpoints[0], endpoints[1:])


@dataclass(frozen=True)
class ArmProblem:
    """A start and goals of an arm among obstacles.

    Attributes
    ----------
    folder : Folder
    name : str
        Name of the problem set.
    row : mapping
        Row of the file.
    start : ndarray of float64, shape (dof,)
    goals : ndarray of float64, shape (n, dof)
    """

    folder: Folder
    name: str
    row: Mapping[str, Any]
    start: Floats
    goals: Floats

    @property
    def solids(self) -> list[Solid]:
        """Obstacles."""
        solids = []
        for kind, names in (
            ("box", ["half_extents"]),
            ("cylinder", ["radius", "length"]),
            ("sphere", ["radius"]),
        ):
            for each in self.row[kind]:
                pose = np.eye(4)
                pose[:3, 3] = each["position"]
                pose[:3, :3] = Rotation.from_quat(
                    each.get("orientation_quat_xyzw", (0, 0, 0, 1))
                ).as_matrix()
                sizes = np.concatenate([np.atleast_1d(each[name]) for name in names])
                solids.append(
                    (
                        each["name"],
                        kind,
                        pose,
                        tuple((sizes * (2.0 if kind == "box" else 1.0)).tolist()),
                    )
                )
        return solids

    def space(self) -> ArmSpace:
        return build_arm_space(our_solids(self.solids), self.folder.arm)

    def meshes(self) -> Meshes:
        return Meshes(
            self.folder.urdf, self.folder.arm.joints, coal_solids(self.solids), self.folder.srdf
        )


Solid = tuple[str, str, Floats, tuple[float, ...]]
"""Name, kind, pose, and sides, or radius and length, of a box, a cylinder or a sphere."""


def our_solids(solids: Sequence[Solid]) -> dict[str, PosedShape]:
    """Convert solids to obstacles of this library."""
    make = {
        "box": lambda *sides: Robot.box(sides),
        "cylinder": Robot.cylinder,
        "sphere": Robot.ball,
    }
    return {name: PosedShape(make[kind](*sizes).shape, pose) for name, kind, pose, sizes in solids}


def coal_solids(solids: Sequence[Solid]) -> list[tuple[str, Any, Floats]]:
    """Convert solids to names, geometries and poses for coal."""
    import coal

    make = {"box": coal.Box, "cylinder": coal.Cylinder, "sphere": coal.Sphere}
    return [(name, make[kind](*sizes), pose) for name, kind, pose, sizes in solids]


class Meshes:
    """Meshes of an arm among obstacles, posed by pinocchio and tested by coal.

    Parameters
    ----------
    urdf : Path
    joints : sequence of str
        Joints in the order of configurations.
    solids : sequence of tuple
        Name, coal's geometry and pose of each obstacle.
    srdf : Path, optional
    allowed : set of pairs of str
        Links that may touch, if there is no SRDF.
    """

    def __init__(
        self,
        urdf: Path,
        joints: Sequence[str],
        solids: Sequence[tuple[str, Any, Floats]],
        srdf: Path | None = None,
        allowed: frozenset[tuple[str, str]] = frozenset(),
    ) -> None:
        import pinocchio as pin

        self._pin, self._model = pin, pin.buildModelFromUrdf(str(urdf), mimic=True)
        model = self._model
        geometry = pin.buildGeomFromUrdf(
            model, str(urdf), pin.GeometryType.COLLISION, package_dirs=[str(urdf.parent)]
        )
        links = list(geometry.geometryObjects)
        for each in links:
            if each.meshPath.lower().endswith(".obj"):
                each.geometry = _read_geometry(each.meshPath, tuple(each.meshScale))
        geometry.addAllCollisionPairs()
        if srdf is not None:
            pin.removeCollisionPairs(model, geometry, str(srdf))
        for i, one in enumerate(links):
            for j, other in enumerate(links[:i]):
                names = sorted(model.frames[each.parentFrame].name for each in (one, other))
                if tuple(names) in allowed:
                    geometry.removeCollisionPair(pin.CollisionPair(j, i))
        for name, shape, pose in solids:
            placed = pin.GeometryObject(name, 0, pin.SE3(pose[:3, :3], pose[:3, 3]), shape)
            number = geometry.addGeometryObject(placed)
            for i, each in enumerate(links):
                if each.parentJoint:
                    geometry.addCollisionPair(pin.CollisionPair(i, number))
        self._geometry, self._data, self._placed = (
            geometry,
            model.createData(),
            geometry.createData(),
        )
        self._joints = [
            (model.joints[n].idx_q, model.joints[n].nq) for n in map(model.getJointId, joints)
        ]

    def rotation(self, q: Floats, frame: str) -> Floats:
        """Return the rotation of a frame at a configuration, shape (3, 3)."""
        self._pin.framesForwardKinematics(self._model, self._data, self._of(q))
        number = self._model.getFrameId(frame)
        return np.array(self._data.oMf[number].rotation)

    def collides(self, q: Floats) -> bool:
        """Return True if links collide at a configuration, shape (dof,)."""
        arguments = (self._model, self._data, self._geometry, self._placed, self._of(q))
        return bool(self._pin.computeCollisions(*arguments, True))

    def distance(self, q: Floats) -> float:
        """Return the distance of the nearest pair in metres; negative in collision."""
        self._pin.computeDistances(
            self._model, self._data, self._geometry, self._placed, self._of(q)
        )
        return min((each.min_distance for each in self._placed.distanceResults), default=np.inf)

    def is_wrong(self, q: Floats) -> bool:
        """Return True if a configuration certainly collides."""
        return self.collides(q) and self.distance(q) < COAL_TOLERANCE

    def first_collision(self, q0: Floats, q1: Floats, step: float) -> float | None:
        """Return the share of a motion before a collision, or None; ``step`` is per joint."""
        count = max(1, int(np.ceil(np.abs(q1 - q0).max() / step)))
        for part in np.linspace(0.0, 1.0, count + 1):
            if self.is_wrong(q0 + part * (q1 - q0)):
                return float(part)
        return None

    def _of(self, q: Floats) -> Floats:
        """Convert a configuration to pinocchio's, with cosine and sine of continuous joints."""
        numbers = np.zeros(self._model.nq)
        for value, (first, size) in zip(q, self._joints, strict=True):
            numbers[first : first + size] = value if size == 1 else (np.cos(value), np.sin(value))
        return numbers


@cache
def _read_geometry(path: str, scale: tuple[float, float, float]) -> Any:
    """Read the triangles of a mesh file for coal.

    Pinocchio's reader confuses vertices if an OBJ has several objects: only 161 of the 1308
    triangles of a Panda's sixth link are right, which gives false collisions and misses true ones.
    """
    import coal
    import trimesh

    mesh: Any = trimesh.load(path, force="mesh", process=False)
    triangles = mesh.triangles * scale
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(triangles), 3 * len(triangles))
    for triangle in triangles:
        model.addTriangle(*triangle)
    model.endModel()
    return model


def check_discrete(meshes: Meshes, arm: Arm, q0: Floats, q1: Floats) -> bool:
    """Return True if a motion is free at OMPL's default resolution."""
    extent = float(np.linalg.norm(arm.upper - arm.lower))
    count = max(1, int(np.ceil(np.linalg.norm(q1 - q0) / (OMPL_RESOLUTION * extent))))
    return not any(
        meshes.collides(q0 + part * (q1 - q0)) for part in np.linspace(0.0, 1.0, count + 1)
    )


class Vamp:
    """VAMP's checks and planner for a problem.

    Attributes
    ----------
    own_seconds : float
        Time of the last search by VAMP's clock, without the passing of arguments.
    """

    def __init__(self, problem: ArmProblem) -> None:
        import vamp

        self.own_seconds = 0.0

        self._module, self._plan, self._settings, self._simplify = (
            vamp.configure_robot_and_planner_with_kwargs(problem.folder.robot, "rrtc")
        )
        self._environment = vamp.problem_dict_to_vamp(problem.row)
        self._order = [problem.folder.arm.joints.index(name) for name in self._module.joint_names()]
        self._back = np.argsort(self._order)

    def is_free(self, q: Floats) -> bool:
        return bool(self._module.validate(q[self._order].tolist(), self._environment))

    def motion_is_free(self, q0: Floats, q1: Floats) -> bool:
        return bool(
            self._module.validate_motion(q0[self._order], q1[self._order], self._environment)
        )

    def solve(self, start: Floats, goals: Floats) -> Floats | None:
        """Return a path after VAMP's simplification, or None."""
        sampler = self._module.halton()
        solution = self._plan(
            start[self._order].tolist(),
            goals[:, self._order].tolist(),
            self._environment,
            self._settings,
            sampler,
        )
        if not solution.solved:
            return None
        simple = self._module.simplify(solution.path, self._environment, self._simplify, sampler)
        self.own_seconds = 1e-9 * (solution.nanoseconds + simple.nanoseconds)
        return np.asarray(simple.path.numpy(), dtype=np.float64)[:, self._back]


def solve_by_ompl(
    meshes: Meshes, arm: Arm, start: Floats, goals: Floats, seed: int, seconds: float
) -> Floats | None:
    """Return a path by OMPL's RRTConnect with coal in the callback, or None."""
    from ompl import base as ob
    from ompl import geometric as og
    from ompl import util as ou

    class Checker(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            return not meshes.collides(np.array([state[k] for k in range(arm.dof)]))

    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    states, bounds = ob.RealVectorStateSpace(arm.dof), ob.RealVectorBounds(arm.dof)
    for k in range(arm.dof):
        bounds.setLow(k, float(arm.lower[k]))
        bounds.setHigh(k, float(arm.upper[k]))
    states.setBounds(bounds)
    setup = og.SimpleSetup(states)
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(Checker(si))

    def state_of(q: Floats) -> Any:
        state = si.allocState()
        for k in range(arm.dof):
            state[k] = float(q[k])
        return state

    setup.setStartState(state_of(start))
    goal = ob.GoalStates(si)
    for each in goals:
        goal.addState(state_of(each))
    setup.setGoal(goal)
    setup.setPlanner(og.RRTConnect(si))
    setup.solve(seconds)
    if not setup.haveExactSolutionPath():
        return None
    return np.array(
        [[state[k] for k in range(arm.dof)] for state in setup.getSolutionPath().getStates()]
    )
