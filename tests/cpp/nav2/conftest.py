"""Commands that build maps, or do something else in their place."""

import sys

import pytest


@pytest.fixture
def write_script(tmp_path):
    """Return a function that writes a script of the shell; it returns the path."""

    def write_script(text):
        script = tmp_path / f"script{len(list(tmp_path.iterdir()))}"
        script.write_text(f"#!/bin/sh\n{text}\n")
        script.chmod(0o755)
        return script

    return write_script


@pytest.fixture
def builder(write_script, tmp_path):
    """Return a command that builds maps, and says so in a file."""
    return write_script(f'echo >> {tmp_path}/calls\nexec {sys.executable} -m cspace "$@"')
