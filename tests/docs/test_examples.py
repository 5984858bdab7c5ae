"""Pictures that examples and tutorials write to files."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

from tests.helpers.repository import ROOT

EXAMPLE_SCRIPTS = sorted(
    file for folder in ("examples", "tutorials") for file in (ROOT / folder).glob("*.py")
)
QUICK_EXAMPLES = ("best_placements", "packing", "robots", "sources")


@pytest.mark.parametrize("script", EXAMPLE_SCRIPTS, ids=lambda script: script.stem)
def test_scripts_write_their_pictures_and_open_no_window(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert not re.search(r"\bplt\.show\(", text)
    if "pyplot" in text:
        assert re.search(r"savefig\(|\.save\(", text)


@pytest.mark.parametrize("name", QUICK_EXAMPLES)
def test_an_example_without_display_prints_the_name_of_its_picture(
    name: str, tmp_path: Path
) -> None:
    environment = {
        key: value for key, value in os.environ.items() if key not in ("DISPLAY", "MPLBACKEND")
    }
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", ROOT / "examples" / f"{name}.py"],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert f"{name}.png" in done.stdout
    with Image.open(tmp_path / f"{name}.png") as picture:
        assert len(picture.convert("L").getcolors()) > 10
