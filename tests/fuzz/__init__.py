"""Random cases checked against exact geometry.

Run ``python -m tests.fuzz --help`` for the options. The modules ``plane`` and ``space`` draw random
scenes, for tests and benchmarks too.
"""
