"""OMPL: its state spaces, callbacks and planners, over edges of a space.

:func:`planners._ompl.search.run_ompl` takes a task, and gives the result of an OMPL planner.

OMPL's objects must be gone before the interpreter ends, or its bindings report leaks: create them
inside functions.
"""
