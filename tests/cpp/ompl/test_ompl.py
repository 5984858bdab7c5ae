"""OMPL's checkers in C++ answer as the map does."""

import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from tests.helpers.cpp import (
    SOURCE,
    build_program,
    build_space,
    draw_queries,
    ompl_flags,
    why_no_compiler,
)
from tests.helpers.repository import ROOT

pytestmark = [
    pytest.mark.skipif(bool(why_no_compiler()), reason=why_no_compiler()),
    pytest.mark.skipif(
        not ompl_flags(),
        reason="no OMPL for C++ is here; install libompl-dev and pkg-config to test cspace/ompl.hpp",
    ),
]


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    target = tmp_path_factory.mktemp("program") / "ompl_answers"
    return build_program(target, "-O0", *ompl_flags(), source=SOURCE.with_name("ompl_answers.cpp"))


@pytest.mark.parametrize("name", ["R2", "SE2", "R3", "R3 yaw", "SE3"])
def test_checkers_answer_as_the_map_and_spaces_have_projections(tmp_path, program, name):
    space = build_space(name, "blocked")
    space.save(tmp_path / "map", clearance=True)
    queries = draw_queries(space, 600, np.random.default_rng(6))
    queries = queries[(np.abs(queries) < 1e3).all(axis=1)]
    first, last = np.split(queries, 2, axis=1)
    first, last = (space.rotations.make_canonical(q) for q in (first, last))
    text = "\n".join(" ".join(map(repr, row)) for row in np.hstack([first, last]).tolist())
    done = subprocess.run(
        [str(program), str(tmp_path / "map")],
        input=text,
        text=True,
        capture_output=True,
        check=True,
    )
    rows = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
    free, clearance, valid, agrees, share = rows[:, :5].T
    reached = rows[:, 5:]
    assert len(rows) == len(first)
    assert agrees.all()
    np.testing.assert_array_equal(free == 1, space.is_free(first))
    np.testing.assert_array_equal(clearance, space.clearance(first))
    np.testing.assert_array_equal(valid == 1, space.motion_is_free(first, last))
    np.testing.assert_array_equal(share[valid == 1], 1.0)
    np.testing.assert_array_equal(reached[valid == 1], last[valid == 1])
    part = (valid == 0) & (share > 0.0)
    assert part.any()
    assert np.all(space.motion_is_free(first[part], reached[part]))
    assert np.all(share[valid == 0] < 1.0)


@pytest.mark.skipif(shutil.which("cmake") is None, reason="no cmake is here; install cmake")
def test_cmake_builds_the_example_whose_paths_python_certifies(tmp_path):
    script = ROOT / "examples" / "cpp" / "compare.py"
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, text=True, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    for planner in ("RRTConnect", "BITstar"):
        assert re.search(rf"^{planner}: certify_path is True$", done.stdout, re.MULTILINE)
