"""``python -m cspace``: the command line."""

from cspace._cli import main

main()
