"""A checker of answers about motions, which imports numpy, shapely and python-fcl alone.

It takes plain values and returns a :class:`tests.checker.verdict.Verdict`; see README.md.
"""
