"""The errors that this library raises on purpose, under one base class.

Every message names the offending value, the rule that it breaks and the mend.
"""


class CspaceError(Exception):
    """Base class of all errors raised by ``cspace`` and ``planners``."""


class InputError(CspaceError, ValueError):
    """A value passed by the caller breaks a stated rule."""


class GeometryError(InputError):
    """A robot or obstacle shape is empty, self-crossing, not finite or of the wrong dimension."""


class FileError(CspaceError, OSError):
    """A file is missing, unreadable, malformed, truncated, or may not be written."""


class MissingPackageError(CspaceError, ImportError):
    """An optional package is needed and is not installed; the message names the command that installs it."""


class ConfigurationError(InputError):
    """A start or goal configuration cannot be used.

    Attributes
    ----------
    nearest : tuple of float or None
        The nearest FREE configuration, where the map has one.
    """

    def __init__(self, message: str, nearest: tuple[float, ...] | None = None) -> None:
        super().__init__(message)
        self.nearest = nearest
