"""The direct engine: a workspace dilated by a robot, 64 cells a word; integers only, and no transform."""

from cspace.bits.dilation import dilate as dilate
from cspace.bits.dilation import dilation_bytes as dilation_bytes
from cspace.bits.dilation import dilation_seconds as dilation_seconds
from cspace.bits.runs import Runs as Runs
