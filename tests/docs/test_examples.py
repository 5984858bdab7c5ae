"""Pictures that examples and tutorials write to files."""

import os
import subprocess
import sys

import pytest
from PIL import Image

from tests.helpers.repository import ROOT

QUICK_EXAMPLES = ("best_placements", "packing", "robots", "sources")


@pytest.mark.parametrize("name", QUICK_EXAMPLES)
def test_an_example_without_display_prints_the_name_of_its_picture(name, tmp_path):
    environment = {
        key: value for key, value in os.environ.items() if key not in ("DISPLAY", "MPLBACKEND")
    }
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", ROOT / "examples" / f"{name}.py"],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert f"{name}.png" in done.stdout
    with Image.open(tmp_path / f"{name}.png") as picture:
        assert len(picture.convert("L").getcolors()) > 10
