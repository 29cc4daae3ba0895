"""Design of parallel mechanisms: workspace, dexterity and Pareto fronts with error bars.

>>> import pmopt
>>> design = pmopt.mechanism("2pauu-ppap").design(l1=0.8)
>>> result = design.workspace(samples=1_000_000)
>>> result.volume  # prints as 4.590 ± 0.012 m^3

The names below are loaded on first use, so that ``import pmopt`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pmopt.version import __version__

if TYPE_CHECKING:
    from pmopt.analysis.record import Subject
    from pmopt.api import (
        Design,
        MechanismHandle,
        batch,
        capability,
        certify,
        certify_volume,
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
        warmup,
        workspace,
    )
    from pmopt.api.inputs import Limits, Sampling
    from pmopt.api.results.certification import CertifiedVolume, Claim
    from pmopt.api.results.kinematics import (
        ForwardResult,
        InverseResult,
        JacobianResult,
        MobilityResult,
    )
    from pmopt.api.results.runs import BatchResult, MotionRun, ParetoRun, SimulationRun
    from pmopt.api.results.singularities import SingularityResult
    from pmopt.api.results.sizing import Capability
    from pmopt.api.results.workspace import WorkspaceResult
    from pmopt.errors import (
        InfeasibleError,
        InputError,
        InputErrors,
        PmoptError,
        UnreachableError,
    )
    from pmopt.quantity import Quantity

#: Names by the module that has them.
_PLACES = {
    "pmopt.analysis.record": ("Subject",),
    "pmopt.api": (
        "Design", "MechanismHandle", "batch", "capability", "certify", "certify_volume", "fk",
        "ik", "jacobian", "mechanism", "mechanism_names", "mjcf", "mobility", "motion", "pareto",
        "simulate", "singularities", "warmup", "workspace",
    ),
    "pmopt.api.inputs": ("Limits", "Sampling"),
    "pmopt.quantity": ("Quantity",),
    "pmopt.errors": (
        "InfeasibleError", "InputError", "InputErrors", "PmoptError", "UnreachableError",
    ),
    "pmopt.api.results.kinematics": (
        "ForwardResult", "InverseResult", "JacobianResult", "MobilityResult",
    ),
    "pmopt.api.results.runs": ("BatchResult", "MotionRun", "ParetoRun", "SimulationRun"),
    "pmopt.api.results.certification": ("CertifiedVolume", "Claim"),
    "pmopt.api.results.singularities": ("SingularityResult",),
    "pmopt.api.results.sizing": ("Capability",),
    "pmopt.api.results.workspace": ("WorkspaceResult",),
}  # fmt: skip
_PLACE = {name: module for module, names in _PLACES.items() for name in names}

__all__ = [
    "BatchResult",
    "Capability",
    "CertifiedVolume",
    "Claim",
    "Design",
    "ForwardResult",
    "InfeasibleError",
    "InputError",
    "InputErrors",
    "InverseResult",
    "JacobianResult",
    "Limits",
    "MechanismHandle",
    "MobilityResult",
    "MotionRun",
    "ParetoRun",
    "PmoptError",
    "Quantity",
    "Sampling",
    "SimulationRun",
    "SingularityResult",
    "Subject",
    "UnreachableError",
    "WorkspaceResult",
    "__version__",
    "batch",
    "capability",
    "certify",
    "certify_volume",
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
    "warmup",
    "workspace",
]


if not TYPE_CHECKING:  # a misspelt name is an error of the type checker too

    def __getattr__(name: str) -> Any:
        if name not in _PLACE:
            raise AttributeError(f"module 'pmopt' has no attribute {name!r}")
        return getattr(importlib.import_module(_PLACE[name]), name)


def __dir__() -> list[str]:
    return __all__
