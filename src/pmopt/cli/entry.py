"""Console entry point: signals are taken over before anything that takes time to import."""

from __future__ import annotations

import sys

from pmopt.cli import interrupt


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        interrupt.install()
        from pmopt.cli.main import run

        code = run()
    except interrupt.Interrupted:
        interrupt.disarm()
        print("error: interrupted", file=sys.stderr)
        code = 130
    if code == 130:
        interrupt.leave(code)
    sys.exit(code)
