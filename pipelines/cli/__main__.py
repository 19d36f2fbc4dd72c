"""`python -m pipelines.cli`: the command without its console script."""

from pipelines.cli import main

main()
