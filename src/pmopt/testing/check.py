"""Every check of a mechanism, in order: what rests on one that is not held is left out."""

from __future__ import annotations

from pmopt.mechanisms.mechanism import Mechanism
from pmopt.testing import declarations, geometry, kinematics
from pmopt.testing.findings import Examination
from pmopt.testing.subject import Subject


def examine(mechanism: Mechanism, seed: int = 1) -> Examination:
    """Check that a mechanism is consistent; return what was compared and what was found.

    Nothing is compiled: kernels are evaluated as the plain Python that they are, at some tens of
    random poses of the default design.

    Parameters
    ----------
    mechanism : Mechanism
    seed : int
        Of the poses.
    """
    found = Examination(str(getattr(mechanism, "name", type(mechanism).__name__)))
    with found.guard("declarations"):
        declarations.check_words(found, mechanism)
    if not found.held:
        return found
    with found.check("defaults", "parameters", "the default design") as c:
        subject = Subject(mechanism, seed)
        c.require(True, "")
    if not found.held:
        return found
    for stage in _STAGES:
        for check in stage:
            name = check.__name__.removeprefix("check_").replace("_", "-")
            with found.guard(name):
                check(found, subject)
        if not found.held:
            break
    return found


def _check_text(found: Examination, subject: Subject) -> None:
    declarations.check_text(found, subject.mechanism)


_STAGES = (
    (declarations.check_ranges,),
    (declarations.check_kernel_lengths,),
    (kinematics.check_home,),
    (declarations.check_lengths, _check_text),
    (
        kinematics.check_margin,
        kinematics.check_box,
        kinematics.check_line,
        kinematics.check_velocity_maps,
        kinematics.check_entries,
        kinematics.check_determinant,
        kinematics.check_forward,
        geometry.check_platform,
        geometry.check_screws,
        geometry.check_posture,
        geometry.check_skeleton,
    ),
)


def check_mechanism(mechanism: Mechanism, seed: int = 1) -> Examination:
    """Check that a mechanism is consistent; see :func:`examine`.

    Raises
    ------
    MechanismError
        Naming the first thing that is wrong in one line; ``findings`` has all of them.
    """
    found = examine(mechanism, seed)
    found.require_held()
    return found
