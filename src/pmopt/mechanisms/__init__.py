"""The catalogue: one file a mechanism, found by scanning this package and entry points."""

from pmopt.mechanisms.mechanism import Mechanism
from pmopt.mechanisms.registry import PluginWarning, find, left_out, names

__all__ = ["Mechanism", "PluginWarning", "find", "left_out", "names"]
