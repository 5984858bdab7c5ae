"""``python -m cspace``: the command line."""

from cspace.cli import main

main()
