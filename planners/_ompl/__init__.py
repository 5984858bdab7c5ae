"""OMPL: its state spaces, callbacks and planners, over edges of a space.

:func:`planners._ompl.search.search` takes a task, and gives the result of one of OMPL's planners.

OMPL's objects must be gone before the interpreter ends, or its bindings report leaks: create them
inside functions.
"""
