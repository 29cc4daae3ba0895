"""Mobility as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pmopt.reporting.tables.table import Cell, Shown, Table, design_facts, facts
from pmopt.units import ONE

if TYPE_CHECKING:
    from pmopt.analysis.mobility.freedom import Decomposition, MobilityResult
    from pmopt.analysis.mobility.screws import Screw


def mobility_tables(result: MobilityResult) -> list[Table]:
    """Return the counts, the systems of platform and limbs, and the loops."""
    return [_counts(result), _systems(result), _loops(result)]


def mobility_data(result: MobilityResult) -> list[Table]:
    """Return all of it for CSV."""
    pose = result.pose or {}
    kept, dropped = result.rank_gap
    numbers: dict[str, tuple[float | int | None, str]] = {
        **{f"pose {name}": (value, result.units[name]) for name, value in pose.items()},
        "least singular value kept": (kept, ONE),
        "largest singular value dropped": (dropped, ONE),
        **design_facts(result.params, result.units),
    }
    texts = {"mechanism": result.mechanism, "layout": result.layout,
             "layout note": result.layout_note, "working mode": result.working_mode}  # fmt: skip
    return [*mobility_tables(result), facts(numbers, texts)]


def _counts(result: MobilityResult) -> Table:
    cycle, agreement = result.full_cycle, result.closed_form
    kinds = ", ".join(f"{kind} at {count}" for kind, count in cycle.kinds.items())
    kept, dropped = result.rank_gap
    counts: list[tuple[str, Cell, str]] = [
        ("freedom", result.freedom, f"kept by a finite step: {cycle.kept_at_home}"),
        ("kind", result.kind, "translations T, rotations R of the platform"),
        ("full-cycle freedom", cycle.freedom, f"{cycle.samples} configurations: {kinds}"),
        ("characteristic", str(result.poc), "position and orientation: translations, rotations"),
        ("Kutzbach-Gruebler", result.kutzbach_gruebler.mobility,
         f"d (n - g - 1) + sum f + v: {result.kutzbach_gruebler}"),
        ("Gruebler", result.gruebler.mobility, str(result.gruebler)),
    ]  # fmt: skip
    if result.gruebler_revolutes != result.gruebler:
        counts.append(
            ("Gruebler, P_a as 4 R", result.gruebler_revolutes.mobility,
             str(result.gruebler_revolutes))
        )  # fmt: skip
    counts += [
        ("common constraints", len(result.common_constraints), _joined(result.common_constraints)),
        ("redundant constraints", result.redundant_constraints, "of all loops"),
        ("local freedoms", result.local_freedoms, "that move a limb, not the platform"),
        ("coupling degree", result.coupling_degree, _coupling_note(result)),
    ]
    if agreement is not None:
        counts.append(
            ("closed form agrees",
             Shown(int(agreement.holds), "yes" if agreement.holds else "no"),
             f"at {agreement.poses} poses; misfit {agreement.misfit:.1e} characteristic lengths, "
             f"twists {max(agreement.limb_angle, agreement.freedom_angle):.1e}, "
             f"Jacobian {agreement.rate_error:.1e}")
        )  # fmt: skip
    pose = result.pose or {}
    at = ", ".join(f"{k} = {v:.6g} {result.units[k]}" for k, v in pose.items())
    mode = f"; working mode {result.working_mode}" if result.working_mode else ""
    # In CSV what is no number has a column of its own.
    rows = tuple(
        (name, Shown(None, value) if isinstance(value, str) else value,
         value if isinstance(value, str) else None, note)
        for name, value, note in counts
    )  # fmt: skip
    return Table(
        f"{result.mechanism}, layout {result.layout} {at and 'at ' + at}".rstrip(),
        ("quantity", "value", "text", "note"),
        rows,
        {},
        (f"{result.layout_note}{mode}",
         f"ranks: least singular value kept {kept:.2g}, largest dropped {dropped:.1e}"),
        "count",
        prose=("note",),
        only_csv=("text",),
    )  # fmt: skip


def _joined(screws: tuple[Screw, ...]) -> str:
    return "; ".join(s.text("") for s in screws) or "no wrench is common to all limbs"


def _coupling_note(result: MobilityResult) -> str:
    whole, least = result.whole_limbs, result.decomposition
    if whole.coupling is None:
        return "none: the drives do not number the freedoms"
    if least.guide:
        return f"platform guided by {least.guide}; {whole.coupling:g} by whole limbs"
    return "single open chains, whole limbs"


def _systems(result: MobilityResult) -> Table:
    unit = result.length_unit
    rows: list[tuple[Cell, ...]] = []
    last = ("", "")

    def add(body: str, system: str, screws: tuple[Screw, ...]) -> None:
        nonlocal last
        name = f"{system} ({len(screws)})"
        for screw in screws or (None,):
            # A name that is repeated is shown once.
            shown = Shown(body, "" if body == last[0] else body)
            again = Shown(name, "" if (body, name) == last else name)
            last = body, name
            if screw is None:
                rows.append((shown, again, "none", *[None] * 8))
                continue
            point = screw.point or (None,) * 3
            rows.append(
                (shown, again, screw.text(unit), screw.kind, *map(float, screw.direction),
                 *point, screw.pitch)
            )  # fmt: skip

    add("platform", "freedoms", result.freedoms)
    add("platform", "constraints", result.constraints)
    for limb in result.limbs:
        name = f"{limb.name} ({limb.joints}), {limb.poc}"
        add(name, "twists", limb.twists)
        add(name, "wrenches", limb.wrenches)
    numbers = (*(f"direction_{x}" for x in "xyz"), *(f"point_{x}" for x in "xyz"), "pitch")
    return Table("Twist and wrench systems", ("body", "system", "basis", "kind", *numbers),
                 tuple(rows), {}, (), "screw", prose=("basis",),
                 only_csv=("kind", *numbers))  # fmt: skip


def _loops(result: MobilityResult) -> Table:
    parts: list[tuple[str, Decomposition]] = [("as declared", result.declared_order)]
    if result.whole_limbs != result.declared_order:
        parts.append(("least coupled", result.whole_limbs))
    if result.decomposition.guide:
        parts.append((f"guided by {result.decomposition.guide}", result.decomposition))
    rows = tuple(
        (name, i, loop.chain, loop.freedoms, loop.driven, loop.equations, loop.degree)
        for name, part in parts
        for i, loop in enumerate(part.loops, start=1)
    )
    columns = ("order", "loop", "open chain", "freedoms", "driven", "equations",
               "constraint degree")  # fmt: skip
    return Table(
        "Independent loops", columns, rows, {},
        ("equations: dimension of the union of what the chain and the limbs before it generate; "
         "constraint degree: freedoms - driven - equations; k = half the sum of its sizes",),
        "loop",
    )  # fmt: skip
