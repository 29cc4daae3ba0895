"""The catalogue: one file a mechanism, found by scanning this package and entry points."""

from pmopt.mechanisms.mechanism import Mechanism
from pmopt.mechanisms.registry import find, names

__all__ = ["Mechanism", "find", "names"]
