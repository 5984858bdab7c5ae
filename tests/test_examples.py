"""Examples and tutorials write their pictures into files, with or without a display."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image

import cspace

ROOT = Path(cspace.__file__).parents[1]
SCRIPTS = sorted(file for folder in ("examples", "tutorials") for file in (ROOT / folder).glob("*.py"))
QUICK = ("packing", "robots", "sources")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_scripts_write_their_pictures_and_open_no_window(script: Path) -> None:
    text = script.read_text(encoding="utf-8")
    assert not re.search(r"\bplt\.show\(", text)
    if "pyplot" in text:
        assert re.search(r"savefig\(|\.save\(", text)


@pytest.mark.parametrize("name", QUICK)
def test_example_without_display_says_which_picture_it_wrote(name: str, tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key not in ("DISPLAY", "MPLBACKEND")}
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
