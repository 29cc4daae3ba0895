"""All makers."""

from __future__ import annotations

from making import commands, pictures


def register() -> None:
    """Register all makers, once."""
    from making import (  # noqa: F401
        catalogue,
        configuration,
        dynamics,
        names,
        proofs,
        search,
        statistics,
        timings,
    )

    pictures.add_pictures()
    commands.add_commands()
