"""Each test runs somewhere in `.ci/run`."""

import re
import tomllib

from tests.helpers.repository import ROOT


def test_folders_with_sessions_of_their_own_leave_out_no_thorough_test():
    lanes = (ROOT / ".ci/run").read_text()
    options = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
    for folder in set(options["norecursedirs"]) - {".*"}:
        texts = [file.read_text() for file in (ROOT / "tests" / folder).rglob("test_*.py")]
        if any(re.search(r"mark\.thorough|\bfew\(|[(,] ?data\b.*\):", text) for text in texts):
            lane = rf"-s {folder} -- -m ''$|-m .* tests/{folder}$"
            assert re.search(lane, lanes, re.MULTILINE), folder
