"""`python -m viewsep`."""

from viewsep.cli import main

main()
