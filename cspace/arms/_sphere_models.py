"""Sphere models of arms: balls that cover or fill the links, and their files."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal
from xml.etree import ElementTree

import numpy as np

from cspace.arms._checks import check_mapping
from cspace.arms._reading.sphere_files import Sphere, join_numbers, replace_geometry
from cspace.errors import GeometryError, InputError
from cspace.inside import (
    Balls,
    Floats,
    Mesh,
    Shape,
    StrPath,
    check_known,
    check_output,
    check_word,
    join_surfaces,
    names_options,
    read_xml,
    replacing,
    transform_surface,
    warn_user,
)

if TYPE_CHECKING:
    from cspace.inside import Solid
    from cspace.spectral import BallDecomposition


@dataclass(frozen=True, eq=False)
class SphereModel:
    """Balls that cover each link of an arm, or lie inside it.

    Made by :meth:`cspace.Arm.spheres`. ``print`` shows a table with the proof of each link.

    Attributes
    ----------
    name : str
        Name of the robot.
    links : dict of str to BallDecomposition
        The balls of each link, in the frame of the link, metres. ``hausdorff.upper`` bounds how far
        outer balls stick out of the link, or the distance of a point of the link from inner balls.
    """

    name: str
    links: Mapping[str, BallDecomposition] = field(repr=False)

    def __str__(self) -> str:
        """Return a table with a row for each link."""
        kind = next(iter(self.links.values())).kind
        if kind == "outer":
            proof, distance = "covered", "sticks out"
        else:
            proof, distance = "inside", "leaves bare"
        width = max(map(len, self.links))
        count = sum(map(len, self.links.values()))
        lines = [
            f"{self.name}: {count} {kind} spheres on {len(self.links)} links",
            f"{'link':{width}}  spheres  {proof:>7}  {distance:>11}  volume ratio",
        ]
        for name, balls in self.links.items():
            ratio = "no volume"
            if math.isfinite(balls.volume_ratio):
                ratio = f"{balls.volume_ratio:.2f}"
            length = f"{1000.0 * balls.hausdorff.upper:.1f} mm"
            values = f"{len(balls):7}  {'proven':>7}  {length:>11}  {ratio:>12}"
            lines.append(f"{name:{width}}  {values}")
        return "\n".join(lines)

    @names_options
    def save(
        self, path: StrPath, template: StrPath | None = None, *, overwrite: bool = False
    ) -> None:
        """Write the balls to a file whose suffix says the format.

        Parameters
        ----------
        path : path-like
            ``.urdf``: the template, with balls as collision geometry; VAMP reads it, too.
            ``.srdf``: the template, with ``link_sphere_approximation``. ``.yaml`` or ``.yml``:
            ``collision_spheres`` of cuRobo. ``.json``: ``spheres`` of foam by link, whose ``mean``,
            ``best`` and ``worst`` are the proven distance.
        template : path-like, optional
            The URDF that the arm was read from, which ``.urdf`` needs; or an SRDF.
        overwrite : bool
            Whether to replace an existing file.

        Raises
        ------
        InputError
            If the suffix is none of these, or ``.urdf`` has no template.
        FileError
            If the file exists and ``overwrite`` is not set, it cannot be written, or the template
            is missing or malformed.
        """
        suffix = Path(path).suffix.lower()
        check_known(suffix, f"suffix of {os.fspath(path)}", _WRITERS)
        check_output(Path(path), overwrite)
        text = _WRITERS[suffix](self, template)
        with replacing(path, overwrite) as temporary:
            temporary.write_text(text, encoding="utf-8")


def _write_urdf(model: SphereModel, template: StrPath | None) -> str:
    """Return the template with balls as the collision geometry of its links."""
    if template is None:
        raise InputError(
            "template",
            "is missing",
            "a URDF keeps the joints of its source",
        )
    root = read_xml(template, "template")
    links = {name: _list_balls(balls) for name, balls in model.links.items()}
    replace_geometry(root, links)
    return _format_xml(root)


def _write_srdf(model: SphereModel, template: StrPath | None) -> str:
    """Return an SRDF with each link's balls."""
    root = ElementTree.Element("robot", name=model.name)
    if template is not None:
        root = read_xml(template, "template")
    for old in root.findall("link_sphere_approximation"):
        if old.get("link") in model.links:
            root.remove(old)
    for name, balls in model.links.items():
        approximation = ElementTree.SubElement(root, "link_sphere_approximation", link=name)
        for center, radius in _list_balls(balls):
            attributes = {"center": join_numbers(center), "radius": repr(radius)}
            ElementTree.SubElement(approximation, "sphere", attributes)
    return _format_xml(root)


def _write_curobo(model: SphereModel, _: StrPath | None) -> str:
    """Return the balls as a sphere file of cuRobo."""
    lines = ["collision_spheres:"]
    for name, balls in model.links.items():
        lines.append(f"  {json.dumps(name)}:")
        for center, radius in _list_balls(balls):
            lines.append(f"    - center: {center}")
            lines.append(f"      radius: {radius}")
    return "\n".join(lines) + "\n"


def _write_foam(model: SphereModel, _: StrPath | None) -> str:
    """Return the balls as JSON of foam."""
    links = {}
    for name, balls in model.links.items():
        distance = balls.hausdorff.upper
        spheres = [{"origin": center, "radius": radius} for center, radius in _list_balls(balls)]
        errors = dict.fromkeys(("mean", "best", "worst"), distance)
        links[name] = {**errors, "spheres": spheres}
    return json.dumps(links, indent=1) + "\n"


_WRITERS: Final[dict[str, Callable[[SphereModel, StrPath | None], str]]] = {
    ".urdf": _write_urdf,
    ".srdf": _write_srdf,
    ".yaml": _write_curobo,
    ".yml": _write_curobo,
    ".json": _write_foam,
}
"""Writers by suffix; each takes a sphere model and the template."""


def _list_balls(balls: BallDecomposition) -> list[Sphere]:
    """Return the center and radius of each ball."""
    return list(zip(balls.centers.tolist(), balls.radii.tolist(), strict=True))


def _format_xml(root: ElementTree.Element) -> str:
    """Return XML with an indentation."""
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def find_spheres(
    name: str,
    links: Sequence[tuple[Solid, Floats]],
    number: int | Mapping[str, int] | None,
    tolerance: float | None,
    kind: Literal["inner", "outer"],
    progress: Callable[[int, int], None] | None,
) -> SphereModel:
    """Find the balls of links with poses on their bodies; see :meth:`cspace.Arm.spheres`."""
    from cspace.spectral import decompose

    check_word(kind, "kind", ("inner", "outer"))
    found = {}
    shapes = {link.name: _join_parts(link, pose) for link, pose in links}
    numbers = number if isinstance(number, Mapping) else dict.fromkeys(shapes, number)
    check_mapping(numbers, "number", list(shapes))
    if lacking := [name for name in shapes if name not in numbers]:
        raise InputError("number", f"lacks {lacking[0]!r}", "each link with geometry needs one")
    for done, (link, shape) in enumerate(shapes.items()):
        if progress is not None:
            progress(done, len(links))
        if kind == "inner" and not shape.inner.encloses:
            warn_user(f"link {link!r} has no inside, so it gets no balls")
            continue
        try:
            found[link] = decompose(shape, kind=kind, number=numbers[link], tolerance=tolerance)
        except InputError as error:
            if error.argument == "shape":
                raise type(error)(
                    f"link {link!r}", error.problem, error.rule, error.hint
                ) from error
            raise
    if progress is not None:
        progress(len(links), len(links))
    if not found:
        raise GeometryError(
            "kind",
            "is 'inner', but no link has an inside",
            "inner balls need one",
        )
    return SphereModel(name, found)


def _join_parts(link: Solid, pose: Floats) -> Shape:
    """Join the parts of a link, which has a pose on its body, to one shape."""
    from_body = np.linalg.inv(pose)
    sides = []
    for side in ("outer", "inner"):
        parts = [(getattr(part.shape, side), from_body @ part.pose) for part in link.parts]
        if any(isinstance(shape, Balls) for shape, _ in parts):
            raise InputError(
                f"link {link.name!r}",
                "consists of balls already",
                "spheres are found for other shapes",
            )
        surfaces = [transform_surface(shape.surface, pose) for shape, pose in parts]
        # Only shapes with an inside fill the link; a surface around another one changes nothing.
        has_inside = any(shape.encloses for shape, _ in parts)
        sides.append(Mesh(*join_surfaces(surfaces), "auto" if has_inside else "surface", link.name))
    outer, inner = sides
    if all(part.shape.inner is part.shape.outer for part in link.parts):
        return outer
    return outer.with_inner(inner)
