"""Gates: commands are proven before a robot executes them, on any map and for any arm.

They take a space and rows of targets or twists, and give the commands that are proven. A *chunk* is
consecutive commands, proven together.
"""
