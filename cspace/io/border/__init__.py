"""The border of the free space, as triangles and as mesh files."""

from cspace.io.border.surface import free_border as free_border
from cspace.io.border.surface import write_border as write_border
from cspace.io.border.triangles import WRITERS as WRITERS
