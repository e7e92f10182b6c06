"""`python -m lodeflow.cli`."""

from lodeflow.cli import main

main()
