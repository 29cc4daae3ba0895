"""Which settings of a workspace an analysis reads: the others are refused, not dropped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar, get_args, get_origin

from pmopt.analysis.settings import Settings, WorkspaceSettings
from pmopt.analysis.validation import validated
from pmopt.errors import InputError
from pmopt.inputs.fields import Units

Own = TypeVar("Own", bound=Settings)

#: What the index of a pose depends on.
INDEX = frozenset({"norm", "jacobian", "characteristic_length"})
#: Where the index matters only as a bound.
WITH_MIN_LCI = ("min_lci", lambda settings: settings.min_lci > 0)


@dataclass(frozen=True)
class Reads(Generic[Own]):
    """What an analysis reads of the settings of a workspace, declared beside it.

    Attributes
    ----------
    analysis : str
        Its name in messages.
    model : type
        Its settings.
    needs : mapping
        Fields that are read together with something else only: what that is called, and whether
        settings have it.
    instead : str
        What the analysis takes in the place of what it does not read.
    """

    analysis: str
    model: type[Own]
    needs: Mapping[str, tuple[str, Callable[[WorkspaceSettings], bool]]] = field(
        default_factory=dict
    )
    instead: str = ""

    @property
    def fields(self) -> frozenset[str]:
        """The settings of a workspace that it reads."""
        return self.model.shared()

    def check(self, settings: WorkspaceSettings) -> None:
        """Refuse the first setting that differs from its default and changes nothing here.

        Raises
        ------
        InputError
        """
        for name, info in WorkspaceSettings.model_fields.items():
            value = getattr(settings, name)
            if value == info.get_default(call_default_factory=True):
                continue
            if name not in self.fields or not self._takes(name, value):
                raise self._unread(name, value)
            other, has = self.needs.get(name, ("", _always))
            if not has(settings):
                raise InputError(
                    f"{self.analysis}: {name}={_shown(value)} is read together with {other} only"
                )

    def settings(self, given: Mapping[str, Any], where: str, units: Units | None = None) -> Own:
        """Return the analysis's own settings.

        Raises
        ------
        InputError
            For what is wrong, and for settings that are others' or change nothing here.
        """
        known = WorkspaceSettings.model_fields
        for name, value in given.items():
            base = name if name in known else name.removesuffix("_deg")
            if base in known and base not in self.model.model_fields:
                plain = known[base].get_default(call_default_factory=True)
                if value is not None and value != plain:
                    raise self._unread(name, value)
        mine = {k: v for k, v in given.items() if not self._others(k)}
        if mine.get("sampler") is not None and not self._takes("sampler", mine["sampler"]):
            raise self._unread("sampler", mine["sampler"])
        found = validated(self.model, mine, where, units)
        self.check(found.of_workspace())
        return found

    def _others(self, name: str) -> bool:
        known = WorkspaceSettings.model_fields
        base = name if name in known else name.removesuffix("_deg")
        return base in known and base not in self.model.model_fields

    def _takes(self, name: str, value: Any) -> bool:
        """Return whether a word that others take is one here, too."""
        whole, own = (_words(m, name) for m in (WorkspaceSettings, self.model))
        return value not in whole or value in own

    def _unread(self, name: str, value: Any) -> InputError:
        also = f"; {self.instead}" if self.instead else ""
        return InputError(
            f"{self.analysis}: {name}={_shown(value)} is not read by {self.analysis}, which reads "
            f"{', '.join(sorted(self.fields))}{also}"
        )


def _shown(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _words(model: type[Settings], name: str) -> tuple[Any, ...]:
    """Return the words that a field takes."""
    annotation = model.model_fields[name].annotation
    return get_args(annotation) if get_origin(annotation) is Literal else ()


def _always(settings: WorkspaceSettings) -> bool:
    return True


def tool_is_read(settings: WorkspaceSettings) -> bool:
    """Return whether a tool changes what is reachable: a limit on it, or its own capsule."""
    on_tool = any(name.startswith("tool_") for name in settings.limits)
    return on_tool or settings.link_diameter is not None


#: A tool where nothing but reach is measured.
TOOL_NEEDS = ("limits on tool_x, tool_y, tool_z or link_diameter", tool_is_read)
