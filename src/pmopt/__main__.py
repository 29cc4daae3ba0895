"""``python -m pmopt``."""

from pmopt.cli.main import main

main()
