"""Soak: random cases, each checked against exact geometry that shares no code with the library.

``python -m tests.soak --help`` says how to run it. The modules ``plane`` and ``space`` draw random scenes, for tests
and benchmarks too.
"""
