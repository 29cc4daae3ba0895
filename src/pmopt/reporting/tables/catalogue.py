"""Mechanisms and what they declare, as tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pmopt.mechanisms.mechanism import PLATFORM
from pmopt.reporting.tables.table import (
    Cell,
    Table,
    facts,
    given,
)
from pmopt.units import span_text

if TYPE_CHECKING:
    from pmopt.mechanisms import Mechanism


def mechanisms_table(mechanisms: Sequence[Mechanism], left_out: Sequence[object] = ()) -> Table:
    """Return the catalogue; plug-ins that are left out are named below."""
    rows = tuple((m.name, m.freedom, m.length_unit, m.description) for m in mechanisms)
    names = ("name", "freedom", "length_unit", "description")
    return Table("Mechanisms", names, rows, {}, tuple(map(str, left_out)), prose=("description",))


def mechanism_document(m: Mechanism) -> dict[str, Any]:
    """Return all a mechanism declares, as JSON has it."""
    limits = [f"{p.name}: {p.meaning}" for p in m.parameters if p.optional]
    limits += _default_limits(m)
    parameters = m.resolve({})
    return {
        "mechanism": m.name,
        "title": m.title,
        "description": m.description,
        "source": m.source,
        "freedom": m.freedom,
        "length_unit": m.length_unit,
        "limbs": [
            {
                "name": x.name,
                "joints": x.joints,
                "joint_names": list(x.joint_names),
                "description": x.description,
            }
            for x in m.limbs
        ],
        "parameters": [
            {
                "name": p.name,
                "unit": m.unit(p),
                "default": p.default,
                "bounds": None if p.bounds is None else list(p.bounds),
                "allowed": p.allowed(),
                "meaning": p.meaning,
                "source": p.source,
            }
            for p in m.parameters
        ],
        "pose": [{"name": c.name, "unit": m.unit(c), "meaning": c.meaning} for c in m.pose],
        **{
            key: [{"name": c.name, "unit": m.unit(c), "meaning": c.meaning} for c in group]
            for key, group in (
                ("joints", m.joints),
                ("passive", m.passive),
                ("parasitic", m.parasitic),
            )
        },
        "home": m.home(parameters),
        "domain": {
            k: [v if math.isfinite(v) else None for v in ends]
            for k, ends in m.default_domain(parameters).items()
        },
        "layouts": dict(m.layouts),
        "working_modes": list(m.working_modes),
        "limits": limits,
        "jacobian": m.default_jacobian,
        "characteristic_length": m.length_meaning,
        "bodies": [
            {
                "name": body.name,
                "limb": "platform" if body.limb == PLATFORM else m.limbs[body.limb].name,
                "mass": body.mass,
                "centre": body.centre.tolist(),
                "inertia": body.inertia.tolist(),
                "source": body.source,
            }
            for body in m.bodies(parameters)
        ],
        "units": {"mass": "kg", "centre": m.length_unit, "inertia": "kg m^2"},
    }


def _default_limits(m: Mechanism) -> list[str]:
    """Return the limits that hold unless others are given, in words, for the default design."""
    units = {c.name: m.unit(c) for c in m.limited}
    limits = m.default_limits(m.resolve({}))
    return [f"{k}: {span_text(ends, units[k])}" for k, ends in limits.items()]


def mechanism_tables(m: Mechanism) -> list[Table]:
    """Return what a mechanism declares, parameters first."""
    names = ("name", "unit", "default", "lower", "upper", "bounds", "meaning", "source")
    parameters = tuple(
        (p.name, m.unit(p), given(p.default), *_range(p.bounds), p.meaning, p.source)
        for p in m.parameters
    )
    coordinates = tuple(
        (kind, c.name, m.unit(c), c.meaning)
        for kind, group in (
            ("pose", m.pose),
            ("parasitic", m.parasitic),
            ("actuated joint", m.joints),
            ("passive joint", m.passive),
        )
        for c in group
    )
    defaults = m.resolve({})
    home = m.home(defaults)
    limits = m.default_limits(defaults)
    units = {c.name: m.unit(c) for c in (*m.limited, *m.pose)}
    spans = [
        *(("domain", name, units[name], *_range(ends))
          for name, ends in m.default_domain(defaults).items()),
        *(("limit", name, units[name], *_range(ends)) for name, ends in limits.items()),
    ]  # fmt: skip
    bodies: tuple[tuple[Cell, ...], ...] = tuple(
        (body.name, body.mass, *(float(body.inertia[k, k]) for k in range(3)), body.source)
        for body in m.bodies(defaults)
    )
    moments = ("Ixx", "Iyy", "Izz")
    optional = tuple(f"{p.name}: {p.meaning}" for p in m.parameters if p.optional)
    tables = [
        Table(f"{m.title}: {m.description}", names, parameters, {},
              (f"source: {m.source}", *(f"limit unless absent: {text}" for text in optional)),
              "parameter", prose=("meaning", "source"), yielding=("source",),
              only_csv=("lower", "upper"), only_shown=("bounds",)),
        Table("Coordinates", ("kind", "name", "unit", "meaning"), coordinates, {}, (), "coordinate",
              prose=("meaning",)),
        Table("Home pose, at the default dimensions", ("name", "unit", "value"),
              tuple((c.name, m.unit(c), home[c.name]) for c in m.pose), {}, (), "home"),
        Table("Ranges unless others are given, at the default dimensions",
              ("kind", "name", "unit", "lower", "upper", "bounds"), tuple(spans), {},
              () if limits else ("no limits of joints",), "range",
              only_csv=("lower", "upper"), only_shown=("bounds",)),
        Table("Limbs", ("name", "joints", "description"),
              tuple((x.name, x.joints, x.description) for x in m.limbs), {},
              (f"working modes: {', '.join(m.working_modes)} (first one is the default)",
               f"LCI: {m.default_jacobian} by default; homogenized by {m.length_meaning}"), "limb",
              prose=("description",)),
        Table("Layouts of pmopt mobility", ("name", "description"), tuple(m.layouts.items()), {},
              (), "layout", prose=("description",)),
        Table("Bodies, at the default dimensions", ("name", "mass", *moments, "source"), bodies,
              {"mass": "kg", **dict.fromkeys(moments, "kg m^2")},
              ("moments about the centre of mass, along the axes of the body's link",), "body",
              prose=("source",), yielding=("source",)),
    ]  # fmt: skip
    return [table for table in tables if table.rows]


def mechanism_data(m: Mechanism) -> list[Table]:
    """Return all that a mechanism declares for CSV."""
    modes = tuple((name, "other" if k else "default") for k, name in enumerate(m.working_modes))
    texts = {
        "mechanism": m.name,
        "title": m.title,
        "description": m.description,
        "source": m.source,
        "freedom": m.freedom,
        "length unit": m.length_unit,
        "jacobian": m.default_jacobian,
        "characteristic length": m.length_meaning,
    }
    return [
        *mechanism_tables(m),
        Table("", ("name", "kind"), modes, {}, key="working mode"),
        facts({}, texts),
    ]


def _range(ends: tuple[float, float] | None) -> tuple[Cell, Cell, Cell]:
    """Return both ends of a range and its text; an open end is none."""
    if ends is None:
        return None, None, None
    lower, upper = (end if math.isfinite(end) else None for end in ends)
    return lower, upper, " .. ".join(f"{end:.6g}" for end in ends)
