"""Command that finds sphere models of arms."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from cspace._cli.files import check_outputs
from cspace._cli.options import (
    AS_JSON,
    OVERWRITE,
    PACKAGE_DIRS,
    SOLID,
    SRDF,
    VISUALS,
    Solid,
    argument,
    drop_unset,
    option,
)
from cspace._cli.report import Stopwatch, show

if TYPE_CHECKING:
    from cspace.arms import SphereModel


def spheres(
    file: Path = argument("URDF", "A robot with joints."),
    output: Path | None = option(
        "FILE",
        "Where to write the spheres: .urdf, for VAMP too; .srdf, added to --srdf; .yaml for "
        "cuRobo; .json for foam.",
        "--output",
        "-o",
    ),
    number: int | None = option("COUNT", "Largest number of spheres of each link."),
    tolerance: float | None = option(
        "METRES", "Largest length by which spheres stick out of a link, instead of --number."
    ),
    kind: Literal["outer", "inner"] = option(
        None, "Whether spheres cover the links, or lie inside them.", default="outer"
    ),
    srdf: Path | None = SRDF,
    solid: Solid | None = SOLID,
    package_dirs: list[Path] | None = PACKAGE_DIRS,
    visuals: bool = VISUALS,
    overwrite: bool = OVERWRITE,
    as_json: bool = AS_JSON,
) -> None:
    """Cover the links of a robot by spheres, and prove it."""
    from cspace.arms import Arm

    # Refuse the output before the work.
    template = None
    if output is not None:
        check_outputs([output], (".urdf", ".srdf", ".yaml", ".yml", ".json"), overwrite)
        template = srdf if output.suffix.lower() == ".srdf" else file
    clock = Stopwatch()
    with clock.step("read"):
        options = drop_unset(srdf=srdf, solid=solid, package_dirs=package_dirs, visuals=visuals)
        arm = Arm.from_urdf(file, **options)
    with clock.step("decompose") as progress:
        model = arm.spheres(number=number, tolerance=tolerance, kind=kind, progress=progress)
    if output is not None:
        model.save(output, template, overwrite=overwrite)
    document: dict[str, Any] = {"output": str(output)} if output else {}
    if as_json:
        document |= {"robot": model.name, "kind": kind, "links": describe_links(model)}
    else:
        typer.echo(str(model))
    show({**document, "seconds": clock.seconds}, as_json)


def describe_links(model: SphereModel) -> dict[str, Any]:
    """Describe what is proven for each link."""
    links = {}
    for name, balls in model.links.items():
        links[name] = {
            "spheres": len(balls),
            "covered": balls.kind == "outer",
            "sticks_out_m" if balls.kind == "outer" else "leaves_bare_m": balls.hausdorff.upper,
            "volume_ratio": balls.volume_ratio,
        }
    return links
