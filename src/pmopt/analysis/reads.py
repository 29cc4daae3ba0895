"""Which settings of a workspace an analysis reads: the others are refused, not dropped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pmopt.analysis.settings import WorkspaceSettings
from pmopt.errors import InputError

#: Which poses are in question.
PLACE = frozenset({"working_mode", "domain", "limits"})
#: What the index of a pose depends on.
INDEX = frozenset({"norm", "jacobian", "characteristic_length"})
#: What else a pose has to keep.
CHECKS = frozenset({"link_diameter", "platform_diameter", "cone_angle", "tool"})
#: Where the index matters only as a bound.
WITH_MIN_LCI = ("min_lci", lambda settings: settings.min_lci > 0)


@dataclass(frozen=True)
class Reads:
    """What an analysis reads of :class:`WorkspaceSettings`, declared beside it.

    Attributes
    ----------
    analysis : str
        Its name in messages.
    fields : frozenset of str
    needs : mapping
        Fields that are read together with something else only: what that is called, and whether
        settings have it.
    values : mapping
        Values of fields that are not read where others of the field are.
    instead : str
        What the analysis takes in the place of what it does not read.
    """

    analysis: str
    fields: frozenset[str]
    needs: Mapping[str, tuple[str, Callable[[WorkspaceSettings], bool]]] = field(
        default_factory=dict
    )
    values: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)
    instead: str = ""

    def check(self, settings: WorkspaceSettings) -> None:
        """Refuse the first setting that differs from its default and changes nothing here.

        Raises
        ------
        InputError
        """
        for name, info in type(settings).model_fields.items():
            value = getattr(settings, name)
            if value == info.get_default(call_default_factory=True):
                continue
            shown = list(value) if isinstance(value, tuple) else value
            if name not in self.fields or value in self.values.get(name, ()):
                known = sorted(self.fields)
                also = f"; {self.instead}" if self.instead else ""
                raise InputError(
                    f"{self.analysis}: {name}={shown} is not read by {self.analysis}, which reads "
                    f"{', '.join(known)}{also}"
                )
            other, has = self.needs.get(name, ("", _always))
            if not has(settings):
                raise InputError(
                    f"{self.analysis}: {name}={shown} is read together with {other} only"
                )


def _always(settings: WorkspaceSettings) -> bool:
    return True


def tool_is_read(settings: WorkspaceSettings) -> bool:
    """Return whether a tool changes what is reachable: a limit on it, or its own capsule."""
    on_tool = any(name.startswith("tool_") for name in settings.limits)
    return on_tool or settings.link_diameter is not None


#: A tool where nothing but reach is measured.
TOOL_NEEDS = ("limits on tool_x, tool_y, tool_z or link_diameter", tool_is_read)
