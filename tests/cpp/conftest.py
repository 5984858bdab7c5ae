"""The program over the C++ header, compiled once."""

import pytest

from tests.helpers.cpp import SANITIZERS, build_program


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    """Return the program with the sanitizers, which end it at the first fault."""
    target = tmp_path_factory.mktemp("program") / "answers"
    return build_program(target, "-O1", *SANITIZERS, "-fno-sanitize-recover=all")
