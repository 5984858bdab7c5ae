# The public module. It is imported at its first use.

from . import ros as ros
