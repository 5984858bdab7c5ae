"""The version of the package: of its files, and of what workers of a cluster must have."""

__version__ = "0.1.0"
