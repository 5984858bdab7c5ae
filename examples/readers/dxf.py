"""Read a DXF drawing, with ezdxf.

Lines and outlines are thin walls, also closed ones; hatches, faces and wide polylines are filled.
Texts and dimensions are left out. What else is left out is printed: layers that are off or frozen,
drawings referred to, and kinds without lines. Invisible entities are no walls.
"""

import ezdxf
import ezdxf.disassemble
import shapely
from ezdxf.units import M, conversion_factor

import cspace
from cspace.errors import FileError

NOTES = {"TEXT", "MTEXT", "ATTRIB", "ATTDEF", "DIMENSION", "LEADER", "MULTILEADER", "VIEWPORT"}
FILLED = {"HATCH", "MPOLYGON", "SOLID", "TRACE", "3DFACE"}


def read_dxf(
    path: str, spacing: float = 0.1, query: str = "*", unit: int | None = None
) -> cspace.Workspace:
    """Read walls; ``query`` selects some, such as ``'*[layer!="DOORS"]'``, ``unit`` is ezdxf's."""
    drawing = ezdxf.readfile(path)
    unit = drawing.units if unit is None else unit
    if unit == 0:
        hint = "ask who drew it, and pass unit=ezdxf.units.MM"
        raise FileError(path, "names no unit", "lengths are needed in metres", hint)
    metres = conversion_factor(unit, M)
    frozen = {layer.dxf.name.lower() for layer in drawing.layers if layer.is_frozen()}
    hidden = {layer.dxf.name.lower() for layer in drawing.layers if layer.is_off()} | frozen
    left_out = {block.name for block in drawing.blocks if block.block.is_xref} | hidden
    entities = [each for each in drawing.modelspace().query(query) if each.dxftype() not in NOTES]
    walls = []
    entities = ezdxf.disassemble.recursive_decompose(entities)
    for part in ezdxf.disassemble.to_primitives(entities):
        kind = part.entity.dxftype()
        if kind in NOTES or not is_shown(part.entity, hidden, frozen):
            continue
        if part.is_empty:
            left_out.add(kind)
        elif part.mesh is not None:
            faces = part.mesh.faces_as_vertices()
            flat = [shapely.MultiPoint([corner.vec2 for corner in face]) for face in faces]
            walls += [face.convex_hull for face in flat]
        else:
            curves = [list(curve.flattening(0.001 / metres)) for curve in part.path.sub_paths()]
            curves = [[point.vec2 for point in curve] for curve in curves if len(curve) > 1]
            walls.append(shapely.MultiLineString(curves))
            if kind in FILLED:
                walls.append(shapely.build_area(shapely.node(walls[-1])))
    print("left out:", sorted(left_out))
    walls = shapely.transform(shapely.union_all(walls), lambda points: metres * points)
    # Curves became chords, which are at most 1 mm away.
    return cspace.Workspace.from_polygons(walls.buffer(0.005), spacing)


def is_shown(entity, hidden: set[str], frozen: set[str]) -> bool:
    """Return True if an entity is visible, in the blocks that hold it, too.

    A part of a block on layer 0 is on the layer of the insertion; a frozen layer hides whole blocks.
    """
    layer = entity.dxf.layer.lower()
    while not entity.dxf.invisible and entity.dxf.layer.lower() not in frozen:
        insertion = entity.source_block_reference
        if insertion is None:
            return layer not in hidden
        entity = insertion
        layer = entity.dxf.layer.lower() if layer == "0" else layer
    return False


if __name__ == "__main__":
    import sys

    print(read_dxf(sys.argv[1]))
