"""Work grows at most as n log n."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.repository import ROOT

PROGRAM = Path(__file__).with_name("count.py")
KINDS = [
    key.value
    for node in ast.parse(PROGRAM.read_text(encoding="utf-8")).body
    if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "KINDS"
    for key in node.value.keys
]
"""Kinds of work, which this process does not import, as kernels are compiled here."""

MAX_RATIO = 5.5
"""Largest ratio of the work that is added from 4 n to 16 n to that from n to 4 n.

It is 4 for n, at most 5.2 for n log n from n = 16 on, and 16 for n^2.
"""

MIN_SHARE = 1 / 16
"""Smallest share of the work on n that counts as added: second questions may take the same work."""


@pytest.mark.parametrize("kind", KINDS)
def test_work_grows_at_most_as_n_log_n(kind):
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(PROGRAM), kind]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, second, third = json.loads(done.stdout)
    added = max(second - first, MIN_SHARE * first)
    assert third - second <= MAX_RATIO * added, (first, second, third)
