"""What a conditioning index is of, in words, and whether it mixes units."""

from __future__ import annotations

from pmopt.mechanisms.mechanism import JacobianKind, Mechanism


def entry_units(mechanism: Mechanism, block: str | None = None) -> str:
    """Return the units of the raw Jacobian's entries in words, of one block's rows if asked for."""
    wanted = {"translational": "length", "rotational": "angle"}.get(block or "")
    rows = zip(mechanism.pose, mechanism.entry_units, strict=True)
    return " and ".join(
        dict.fromkeys(u for c, row in rows if wanted in (None, c.kind) for u in row)
    )


def mixes_units(units: str) -> bool:
    """Return whether entries, their units as :func:`entry_units` gives them, have several."""
    ratios = (unit.split("/") for unit in units.split(" and "))
    return len({"1" if len(r) == 2 and r[0] == r[1] else "/".join(r) for r in ratios}) > 1


def index_note(kind: JacobianKind, length: float | None, unit: str, units: str) -> str:
    """Say what Jacobian an index is of.

    Parameters
    ----------
    kind : {"raw", "homogenized"}
    length : float or None
        Characteristic length.
    unit : str
        Of lengths.
    units : str
        Of the raw Jacobian's entries; see :func:`entry_units`.
    """
    if kind == "raw" and mixes_units(units):
        return f"raw Jacobian, entries in {units}: it mixes units and depends on the unit of length"
    if kind == "raw":
        return f"raw Jacobian, every entry in {units}: one unit, which the index does not depend on"
    text = repr(length) if length is None or len(repr(length)) <= 8 else f"{length:.6g}"
    return f"homogenized Jacobian, characteristic length {text} {unit}"
