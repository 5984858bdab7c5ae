"""Builds planned faults into each Python that a test starts."""

import os

if "CSPACE_FAULTS" in os.environ:
    import tests.faults.hook  # noqa: F401
