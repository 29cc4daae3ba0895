"""The front of the first paper's problem, and its tables: README and the page of 2PaUU-PPaP."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pandas as pd

import pmopt
from making.figures import Figure, rounded, sampled
from making.pages import Picture, Says, Statement, table
from making.registry import maker
from making.words import parameters, run_folder, word
from pmopt.analysis.workspace.compute import WorkspaceResult
from pmopt.mechanisms import find, names

NAME = "2pauu-ppap"
PAGE = "docs/mechanisms/2pauu-ppap.md"
CONFIG = "configs/2pauu-ppap.toml"
#: How far another search of the same problem may end, in m and in objectives.
PLACE, SIZE, INDEX = 0.02, 0.5, 0.001

#: Table 4 of the paper: volume, GCI, and m, n, l1, l2, c in m.
TABLE_4 = {
    1: (5.842, 0.140, 0.857, 0.706, 1.499, 1.5, 0.1),
    2: (6.935, 0.138, 0.719, 0.579, 1.499, 1.5, 0.1),
    3: (10.283, 0.132, 0.516, 0.342, 1.5, 1.5, 0.1),
    4: (12.535, 0.118, 0.500, 0.506, 1.5, 1.5, 0.1),
    5: (9.866, 0.133, 0.509, 0.339, 1.5, 1.5, 0.1),
    6: (7.732, 0.136, 0.506, 0.330, 1.5, 1.5, 0.1),
}
#: Table 5 of the paper: share of the volume by region of LCI, in per cent.
TABLE_5 = {1: (47.2, 43.7, 9.2), 4: (52.1, 42.5, 5.5)}


def design(row: int) -> dict[str, float]:
    """Return a design of table 4."""
    return dict(zip(("m", "n", "l1", "l2", "c"), TABLE_4[row][2:], strict=True))


def _gap(row: pd.Series) -> float:
    return float(row.m - row.n)


@maker("front")
def front() -> Iterator[Statement]:
    """Yield the front of the paper's problem, its ends and its knee."""
    with run_folder("pareto", CONFIG, "--quiet") as folder:
        designs = pd.read_csv(folder / "front.csv")
        picture = (folder / "front.png").read_bytes()
    yield Picture("front.png", picture)
    best, largest = designs.iloc[0], designs.iloc[-1]
    scaled = designs[["volume", "gci"]]
    scaled = (scaled - scaled.min()) / (scaled.max() - scaled.min())
    knee = designs.iloc[int(scaled.sum(axis=1).to_numpy().argmax())]
    torus = math.pi**2 * 1.5 * 1.5**2
    yield Says(
        "README.md",
        "l1 = l2 = 1.5 m, m = n): both limbs then sweep the same torus, the largest volume there "
        "is (pi² l1 l2² = {} m³, GCI {}). At the other end a crank of about three quarters of the "
        "link (l1 = {} m, |m - n| = {} m) gives the largest GCI, {}, for {} % less volume. The "
        "knee lies at l1 = {} m: it keeps {} % of the largest volume and {} % of the largest GCI.",
        (
            rounded(torus, ".2f"),
            rounded(largest.gci, ".3f", within=INDEX),
            rounded(best.l1, ".2f", within=PLACE),
            rounded(abs(_gap(best)), ".2f", within=PLACE),
            rounded(best.gci, ".3f", within=INDEX),
            rounded(100 * (1 - best.volume / largest.volume), ".0f", within=2),
            rounded(knee.l1, ".2f", within=2 * PLACE),
            rounded(100 * knee.volume / largest.volume, ".0f", within=2),
            rounded(100 * knee.gci / best.gci, ".0f", within=2),
        ),
    )

    def row(what: str, d: pd.Series, place: float, size: float) -> tuple[Figure | str, ...]:
        volume = sampled(d.volume, d.volume_error)
        gci = sampled(d.gci, d.gci_error)
        return (
            what,
            rounded(d.l1, ".2f", within=place),
            rounded(d.l2, ".2f"),
            rounded(_gap(d), ".3f", within=place),
            Figure(volume.text, volume.value, volume.error, size),
            Figure(gci.text, gci.value, gci.error, 2 * INDEX),
        )

    yield table(
        PAGE,
        "front",
        ("", "l1 (m)", "l2 (m)", "m - n (m)", "volume (m^3)", "GCI (raw)"),
        (
            row("largest GCI", best, PLACE, SIZE),
            row("knee", knee, 2 * PLACE, 2 * SIZE),
            row("largest volume", largest, 0.005, 0.02),
        ),
    )
    yield Says(PAGE, "the volume pi^2 l1 l2^2 = {} m^3", (rounded(torus, ".2f"),))


@maker("catalogue")
def catalogue() -> Iterator[Statement]:
    """Yield the kind of freedoms of every mechanism, found from its joints."""
    for name in names():
        found = pmopt.mobility(name, samples=2)
        yield Says("README.md", f"| [`{name}`](docs/mechanisms/{name}.md) | {{}} |", (found.kind,))


@maker("front-of-other-indices", slow=True)
def other_indices() -> Iterator[Statement]:
    """Yield the ends of the front of the homogenized index, and of the one in the other norm."""
    ends = {}
    for key, value in (("jacobian", "homogenized"), ("norm", "fro")):
        set_to = f"workspace.{key}={value}"
        with run_folder("pareto", CONFIG, "--quiet", "--set", set_to) as folder:
            designs = pd.read_csv(folder / "front.csv")
        ends[value] = designs.iloc[0], designs.iloc[-1]
    best, largest = ends["homogenized"]
    yield Says(
        PAGE,
        "Divided by l1, the ends move to l1 = {} m, GCI {} and GCI {} at the largest volume",
        (
            rounded(best.l1, ".2f", within=PLACE),
            rounded(best.gci, ".3f", within=INDEX),
            rounded(largest.gci, ".3f", within=INDEX),
        ),
    )
    best, largest = ends["fro"]
    yield Says(
        PAGE,
        "In the Frobenius norm GCI runs from {} to {}.",
        (
            rounded(best.gci, ".3f", within=INDEX),
            rounded(largest.gci, ".3f", within=INDEX),
        ),
    )


def _workspace(row: int, samples: int, cells: int = 0, **settings: object) -> WorkspaceResult:
    return pmopt.workspace(NAME, design(row), samples=samples, shape_grid=cells, **settings)


@maker("table-4")
def table_4() -> Iterator[Statement]:
    """Yield the paper's designs as they are here, and their regions of dexterity."""
    kinds = ({}, {"jacobian": "homogenized"}, {"norm": "fro"})
    found = {row: [_workspace(row, 1_000_000, **kind) for kind in kinds] for row in TABLE_4}
    rows = []
    ratios = {}
    for row, (raw, homogenized, other) in found.items():
        volume, gci = TABLE_4[row][:2]
        ratios[row] = raw.volume.value / volume
        rows.append(
            (
                str(row),
                f"{volume:.3f}, {gci:.3f}",
                sampled(*raw.volume),
                rounded(ratios[row], ".2f", raw.volume.error / volume),
                *(rounded(r.gci.value, ".3f", r.gci.error) for r in (raw, homogenized, other)),
            )
        )
    head = ("", "paper: volume (m^3), GCI", "ours: volume (m^3)", "ratio", "GCI raw",
            "homogenized", "raw, Frobenius")  # fmt: skip
    yield table(PAGE, "table-4", head, rows)
    yield Says(
        PAGE,
        "ratios of ours to the paper's run from {} to {}, so that",
        (rounded(min(ratios.values()), ".2f"), rounded(max(ratios.values()), ".2f")),
    )

    def apart(one: int, two: int) -> tuple[Figure, Figure]:
        gap = max(abs(design(one)[k] - design(two)[k]) for k in design(one))
        volumes = TABLE_4[one][0], TABLE_4[two][0]
        share = 100 * (max(volumes) / min(volumes) - 1)
        return rounded(gap, ".3f"), rounded(share, ".0f")

    yield Says(
        PAGE,
        "Rows 5 and 6 differ by at most {} m in any dimension and yet by {} % in the paper's "
        "volume (rows 3 and 6 by {} m and {} %)",
        (*apart(5, 6), *apart(3, 6)),
    )
    rows = [
        (
            str(row),
            *(
                Figure(f"{100 * r.share.value:.1f} ({p})", 100 * r.share.value, 100 * r.share.error)
                for r, p in zip(found[row][0].regions, shares, strict=True)
            ),
        )
        for row, shares in TABLE_5.items()
    ]
    yield table(PAGE, "table-5", ("", "[0, 0.1)", "[0.1, 0.3)", "[0.3, 1]"), rows)


@maker("pieces-of-2pauu-ppap")
def pieces() -> Iterator[Statement]:
    """Yield how many pieces the regions of two designs have, in all and on the floor."""
    counts = []
    for cells, settings in ((192, {}), (150, {"domain": {"z": (0.2, 0.202)}})):
        for row in (1, 4):
            regions = _workspace(row, 1 << 14, cells, **settings).shape.regions
            counts += [
                word(r.pieces) if r.confirmed else f"{word(r.pieces)} (not confirmed)"
                for r in regions[1:]
            ]
    yield Says(
        PAGE,
        "design 1 has {} pieces of [0.1, 0.3) and {} above 0.3, design 4 {} and {} (",
        tuple(counts[:4]),
    )
    yield Says(
        PAGE,
        "design 1 shows {} and {}, two of the eight so small that they do not survive a coarser "
        "grid, and design 4 {} and {}: the paper's",
        tuple(counts[4:]),
    )


@maker("parameters-of-2pauu-ppap")
def sizes() -> Iterator[Statement]:
    """Yield the table of parameters, and the default workspace's shape."""
    yield parameters(PAGE, find(NAME))
    found = pmopt.workspace(NAME, samples=1 << 16).shape.workspace
    yield Says(
        PAGE,
        "figure 5: half a tyre with a cavity | {} piece. {} enclosed void: the cavity is a pocket",
        (word(found.pieces), word(found.voids).capitalize()),
    )
