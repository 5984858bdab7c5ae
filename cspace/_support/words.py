"""Types of arguments that take one of a few words."""

from __future__ import annotations

from typing import Literal, TypeAlias

Method: TypeAlias = Literal["auto", "fft", "direct"]
"""Engine of :func:`cspace.build`; "auto" takes the faster one."""

Outside: TypeAlias = Literal["blocked", "free"]
"""State of all space outside the bounds of a workspace."""
