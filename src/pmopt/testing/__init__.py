"""A mechanism held against itself: :func:`check_mechanism`, for whoever writes one."""

from pmopt.testing.check import check_mechanism, examine
from pmopt.testing.findings import Check, Examination, Finding, MechanismError

__all__ = ["Check", "Examination", "Finding", "MechanismError", "check_mechanism", "examine"]
