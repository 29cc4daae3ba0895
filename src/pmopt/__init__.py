"""Design of parallel mechanisms: workspace, dexterity and Pareto fronts with error bars.

>>> import pmopt
>>> result = pmopt.workspace("2pauu-ppap", {"l1": 0.8}, samples=1_000_000)
>>> result.volume.value, result.volume.error

The names below are loaded on first use, so that ``import pmopt`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pmopt.version import __version__

if TYPE_CHECKING:
    from pmopt.api import (
        batch,
        capability,
        fk,
        ik,
        jacobian,
        mechanism,
        mechanism_names,
        mjcf,
        mobility,
        motion,
        pareto,
        simulate,
        singularities,
        workspace,
    )
    from pmopt.errors import PmoptError

_PLACES = {
    **dict.fromkeys(
        (
            "batch",
            "capability",
            "fk",
            "ik",
            "jacobian",
            "mechanism",
            "mechanism_names",
            "mjcf",
            "mobility",
            "motion",
            "pareto",
            "simulate",
            "singularities",
            "workspace",
        ),
        "pmopt.api",
    ),
    "PmoptError": "pmopt.errors",
}

__all__ = [
    "PmoptError",
    "__version__",
    "batch",
    "capability",
    "fk",
    "ik",
    "jacobian",
    "mechanism",
    "mechanism_names",
    "mjcf",
    "mobility",
    "motion",
    "pareto",
    "simulate",
    "singularities",
    "workspace",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module 'pmopt' has no attribute {name!r}")
    return getattr(importlib.import_module(_PLACES[name]), name)


def __dir__() -> list[str]:
    return __all__
