"""``python -m pmopt``."""

from pmopt.cli.entry import main

main()
