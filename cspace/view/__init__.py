"""A page in the browser that shows a space, served on this machine (experimental)."""

from cspace.view._viewer import Viewer

__all__ = ["Viewer"]
