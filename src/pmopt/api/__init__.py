"""The public Python interface: functions, designs with methods, and results that show themselves.

``import pmopt`` offers it; nothing within the package but the command line uses it.
"""

from pmopt.api.design import Design, MechanismHandle
from pmopt.api.functions import (
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

__all__ = [
    "Design",
    "MechanismHandle",
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
