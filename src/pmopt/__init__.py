"""Design of parallel mechanisms: workspace, dexterity and Pareto fronts with error bars.

>>> import pmopt
>>> design = pmopt.mechanism("2pauu-ppap").design(l1=0.8)
>>> result = design.workspace(samples=1_000_000)
>>> result.volume.value, result.volume.error

The names below are loaded on first use, so that ``import pmopt`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pmopt.version import __version__

if TYPE_CHECKING:
    from pmopt.analysis.certification.boxes import CertifiedVolume, Claim
    from pmopt.analysis.kinematics.solve import ForwardResult, InverseResult, JacobianResult
    from pmopt.analysis.mobility.freedom import MobilityResult
    from pmopt.analysis.singularities.survey import SingularityResult
    from pmopt.analysis.sizing.actuators import Capability
    from pmopt.analysis.workspace.compute import WorkspaceResult
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
    from pmopt.errors import (
        InfeasibleError,
        InputError,
        InputErrors,
        PmoptError,
        UnreachableError,
    )
    from pmopt.reporting.batch.summary import BatchResult
    from pmopt.reporting.runs.motion_run import MotionRun
    from pmopt.reporting.runs.pareto_run import ParetoRun
    from pmopt.reporting.runs.simulate_run import SimulationRun

#: Names by the module that has them.
_PLACES = {
    "pmopt.api": (
        "Design", "MechanismHandle", "batch", "capability", "certify", "certify_volume", "fk",
        "ik", "jacobian", "mechanism", "mechanism_names", "mjcf", "mobility", "motion", "pareto",
        "simulate", "singularities", "warmup", "workspace",
    ),
    "pmopt.errors": (
        "InfeasibleError", "InputError", "InputErrors", "PmoptError", "UnreachableError",
    ),
    "pmopt.analysis.kinematics.solve": ("ForwardResult", "InverseResult", "JacobianResult"),
    "pmopt.analysis.mobility.freedom": ("MobilityResult",),
    "pmopt.analysis.workspace.compute": ("WorkspaceResult",),
    "pmopt.analysis.singularities.survey": ("SingularityResult",),
    "pmopt.analysis.certification.boxes": ("CertifiedVolume", "Claim"),
    "pmopt.analysis.sizing.actuators": ("Capability",),
    "pmopt.reporting.batch.summary": ("BatchResult",),
    "pmopt.reporting.runs.motion_run": ("MotionRun",),
    "pmopt.reporting.runs.pareto_run": ("ParetoRun",),
    "pmopt.reporting.runs.simulate_run": ("SimulationRun",),
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
    "MechanismHandle",
    "MobilityResult",
    "MotionRun",
    "ParetoRun",
    "PmoptError",
    "SimulationRun",
    "SingularityResult",
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
