"""Maps read from large images, against the time that Pillow takes to decode them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import interleave
from cspace import Workspace

SIZE = 16_384
"""Pixels along each side."""

MOST = 2.0
"""How many times longer than decoding an image, reading a map of it may take."""


def run(report: Report, seed: int) -> None:
    """Images of 8 bits and of one, in colour, and a ROS map."""
    size = 2_048 if report.quick else SIZE
    pixels = np.where(inputs.boxes(size, 0.06, np.random.default_rng(seed)), 0, 254).astype(np.uint8)
    header = "image: L.png\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\n"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "map.yaml").write_text(header)
        for mode in ("L", "1", "RGB"):
            report.section(f"{size} x {size} pixels, PNG of mode {mode}")
            file = Path(folder) / f"{mode}.png"
            Image.fromarray(pixels).convert(mode).save(file, compress_level=1)
            calls = {
                "Pillow": lambda file=file: _decode(file),
                "ours": lambda file=file: Workspace.open(file, spacing=1.0),
            }
            if mode == "L":
                calls["ours, a ROS map"] = lambda: Workspace.open(Path(folder) / "map.yaml")
            timings = interleave(calls, 3)
            decoded = timings.pop("Pillow")
            report.timing("Pillow", decoded)
            for name, timing in timings.items():
                report.timing(name, timing)
                share = timing.median_cpu / decoded.median_cpu
                report.figure(f"{name} / Pillow, CPU time", share, "", most=MOST if name == "ours" else None)
            expected = np.asarray(Image.fromarray(pixels).convert(mode).convert("L"))[::-1].T < 128
            report.check(bool((timings["ours"].value.outer == expected).all()), "cells are the dark pixels")


def _decode(file: Path) -> np.ndarray:
    limit, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        with Image.open(file) as image:
            return np.asarray(image)
    finally:
        Image.MAX_IMAGE_PIXELS = limit
