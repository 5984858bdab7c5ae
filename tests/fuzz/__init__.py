"""New random cases for the laws of the tests, and what fuzzing alone asks.

Run ``python -m tests.fuzz --help`` for the options.
"""
