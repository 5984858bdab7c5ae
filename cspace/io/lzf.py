"""LZF (Lehmann), in which the Point Cloud Library packs its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import jit

Bytes = NDArray[np.uint8]


@jit
def unpack_lzf(packed: Bytes, out: Bytes) -> int:
    """Unpack LZF (Lehmann): runs of literal bytes, and copies of bytes that were written before.

    Returns
    -------
    int
        Number of bytes written, or -1 where the packed bytes end too early, reach back before the first byte, or hold
        more than ``out``.
    """
    read, written = 0, 0
    while read < len(packed):
        control = np.int64(packed[read])
        read += 1
        if control < 32:
            length = control + 1
            if read + length > len(packed) or written + length > len(out):
                return -1
            for _ in range(length):
                out[written] = packed[read]
                written += 1
                read += 1
            continue
        length = control >> 5
        if length == 7:
            if read == len(packed):
                return -1
            length += np.int64(packed[read])
            read += 1
        length += 2
        if read == len(packed):
            return -1
        source = written - ((control & 31) << 8) - np.int64(packed[read]) - 1
        read += 1
        if source < 0 or written + length > len(out):
            return -1
        for _ in range(length):
            out[written] = out[source]
            written += 1
            source += 1
    return written
