"""Checks that a mechanism is consistent: :func:`check_mechanism`, for its author."""

from pmopt.testing.check import check_mechanism, examine
from pmopt.testing.findings import Check, Examination, Finding, MechanismError

__all__ = ["Check", "Examination", "Finding", "MechanismError", "check_mechanism", "examine"]
