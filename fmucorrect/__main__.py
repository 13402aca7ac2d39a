"""`python -m fmucorrect` is the command line."""

from fmucorrect.cli import main

main()
