"""The planner node of cspace for Nav2."""
