"""Records of the fields of files that change what the numbers in them mean."""

from typing import NamedTuple


class Fields(NamedTuple):
    """Fields of a format, by what its reader does with them.

    The module of each reader has a tuple ``FIELDS`` of these, and the page on fields lists them.

    Attributes
    ----------
    files : str
        Suffixes or name of the format, in Markdown.
    honoured, refused, warned : str
        Names of fields, separated by semicolons. A field with any effect on positions, sizes or
        occupancy is in one of them.
    """

    files: str
    honoured: str = ""
    refused: str = ""
    warned: str = ""
