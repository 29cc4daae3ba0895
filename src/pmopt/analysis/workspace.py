"""Volume, dexterity and shape of a workspace, each number with its error estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

from pmopt.analysis.aspects import make_sweeper, require_home
from pmopt.analysis.blocks import blocks_on
from pmopt.analysis.estimates import QUANTILES, Estimate, Estimates, from_grids, from_replicates
from pmopt.analysis.projection import PROJECTION_SAMPLES, Projection, measure_projection
from pmopt.analysis.settings import DEFAULT_SAMPLES, MAX_SAMPLES, WorkspaceSettings, split_samples
from pmopt.analysis.shape import DEFAULT_GRIDS, Shape, check_cells, measure_shape
from pmopt.analysis.sums import Sums
from pmopt.analysis.sweeper import (
    TOOL,
    Design,
    Notify,
    Sweeper,
    Tallies,
    block_length,
    block_ranges,
    check_grid,
    chunk_ranges,
)
from pmopt.analysis.warmup import warm_up
from pmopt.errors import PmoptError
from pmopt.mechanisms.base import JacobianKind, Mechanism
from pmopt.numerics.sequences import BLOCK, Sequence, make_grid
from pmopt.units import ONE, measure_unit, unit_of

if TYPE_CHECKING:
    from pmopt.cluster import Cluster

#: Called with points done and points planned.
Progress = Callable[[int, int], None]
#: Called with what has been summed after every whole block: to go on from it another time.
Keep = Callable[[Sums], None]

#: Spacings of the coarser grids that estimate a grid's error, relative to its own.
_COARSER_GRIDS = (0.4, 0.5, 0.6, 0.7)
#: Samples of the first round to a target error; on lines, exact along one coordinate, fewer do.
_FIRST_ROUND = 1 << 18
_FIRST_ON_LINES = 1 << 15
#: Samples of the home aspect or of a block: each costs some hundred times a compiled one.
FIELD_SAMPLES = 1 << 20


@dataclass(frozen=True)
class Region:
    """A dexterity region: LCI in [lower, upper), the last one closed."""

    lower: float
    upper: float
    volume: Estimate
    share: Estimate


@dataclass(frozen=True)
class WorkspaceResult:
    """A workspace: every number in the unit that ``units`` gives."""

    mechanism: str
    params: dict[str, float | None]
    length_unit: str
    working_mode: str
    norm: str
    jacobian: JacobianKind
    characteristic_length: float | None
    sampler: str
    seed: int
    grid: int | None
    replicates: int
    box: dict[str, tuple[float, float]]
    limits: dict[str, tuple[float, float]]
    settings: WorkspaceSettings
    volume: Estimate
    volume_unit: str
    gci: Estimate
    smallest: Estimate
    largest: Estimate
    quantiles: tuple[Estimate, ...]
    regions: tuple[Region, ...]
    samples: int
    reachable: int
    histogram: tuple[float, ...] = field(repr=False)
    shape: Shape | None
    projection: Projection | None
    units: dict[str, str]

    @property
    def index_note(self) -> str:
        """What the index is of, and that it mixes units where it does."""
        note = index_note(
            self.jacobian, self.characteristic_length, self.length_unit, self.units["J"]
        )
        return f"{self.settings.block} rows of the {note}" if self.settings.block else note

    def _projected(self, name: str, unit: str) -> dict[str, Any] | None:
        if self.projection is None:
            return None
        found: Estimate = getattr(self.projection, name)
        entry = {
            "value": number(found.value),
            "unit": self.units[unit],
            "standard_error": number(found.error),
        }
        if name == "volume" and self.projection.lower:
            entry["bound"] = "lower"
        return entry

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        quantiles = dict(zip(map(str, QUANTILES), self.quantiles, strict=True))
        return {
            "mechanism": self.mechanism,
            "params": self.params,
            "length_unit": self.length_unit,
            "working_mode": self.working_mode,
            "norm": self.norm,
            "jacobian": self.jacobian,
            "characteristic_length": self.characteristic_length,
            "index_note": self.index_note,
            "sampler": {
                "name": self.sampler,
                "samples": self.samples,
                "seed": self.seed,
                "grid": self.grid,
                "replicates": self.replicates,
                "error_estimate": "refinement" if self.grid else "replicates",
            },
            "domain": {name: list(ends) for name, ends in self.box.items()},
            "limits": {name: [number(end) for end in ends] for name, ends in self.limits.items()},
            "min_lci": self.settings.min_lci,
            "aspect": self.settings.aspect,
            "block": self.settings.block,
            "clearances": {
                name: getattr(self.settings, name)
                for name in ("link_diameter", "platform_diameter", "cone_angle")
            },
            "tool": None if self.settings.tool is None else list(self.settings.tool),
            "volume": {
                "value": number(self.volume.value),
                "unit": self.volume_unit,
                "standard_error": number(self.volume.error),
            },
            "gci": {
                "value": number(self.gci.value),
                "standard_error": number(self.gci.error),
            },
            "lci": {
                "min": number(self.smallest.value),
                "max": number(self.largest.value),
                "mean": number(self.gci.value),
                "quantiles": {q: number(e.value) for q, e in quantiles.items()},
                "standard_error": {
                    "min": number(self.smallest.error),
                    "max": number(self.largest.error),
                    "mean": number(self.gci.error),
                    "quantiles": {q: number(e.error) for q, e in quantiles.items()},
                },
            },
            "regions": [
                {
                    "lower": r.lower,
                    "upper": r.upper,
                    "volume": number(r.volume.value),
                    "share": number(r.share.value),
                    "volume_standard_error": number(r.volume.error),
                    "share_standard_error": number(r.share.error),
                }
                for r in self.regions
            ],
            "shape": self.shape.to_dict() if self.shape else None,
            "projected_volume": self._projected("volume", "projected_volume"),
            "projected_shape": None
            if self.projection is None
            else {"grid": self.projection.grid, **asdict(self.projection.shape)},
            "footprint": self._projected("footprint", "footprint"),
            "samples": self.samples,
            "reachable": self.reachable,
            "units": self.units,
        }


def number(value: float) -> float | None:
    """Return the value, None for NaN and infinity, which have no place in JSON."""
    return value if math.isfinite(value) else None


def mixed_units(mechanism: Mechanism) -> str:
    """Return the units of the raw Jacobian's entries in words."""
    return " and ".join(dict.fromkeys(u for row in mechanism.entry_units for u in row))


def index_note(kind: JacobianKind, length: float | None, unit: str, units: str) -> str:
    """Say what Jacobian an index is of."""
    if kind == "raw":
        return f"raw Jacobian, entries in {units}: it mixes units and depends on the unit of length"
    return f"homogenized Jacobian, characteristic length {length!r} {unit}"


def compute_workspace(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None = None,
    settings: WorkspaceSettings | None = None,
    *,
    seed: int = 1,
    threads: int | None = None,
    shape_grid: int | None = None,
    progress: Progress | None = None,
    notify: Notify | None = None,
    begun: Sums | None = None,
    keep: Keep | None = None,
    cluster: Cluster | None = None,
) -> WorkspaceResult:
    """Sample the workspace of one design.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    settings : WorkspaceSettings, optional
    seed : int
    threads : int, optional
        The result is the same for any number.
    shape_grid : int, optional
        Cells per axis on which pieces and voids are counted (default: by the number of
        coordinates, see :data:`pmopt.analysis.shape.DEFAULT_GRIDS`); 0 leaves the shape out, and
        the positions reached with it.
    progress, notify : callable, optional
    begun : Sums, optional
        What ``keep`` was given in a run that was cut off, with the same arguments but for more
        samples or a smaller target error: the result is that of a run in one go.
    keep : callable, optional
    cluster : Cluster, optional
        Sums the blocks on its workers: the result is the same.

    Raises
    ------
    InputError
        For unknown names and values out of range.
    PmoptError
        When ``target_error`` is not reached within the largest number of samples.
    """
    settings = settings or WorkspaceSettings()
    dimension = len(mechanism.pose)
    cells = DEFAULT_GRIDS[dimension] if shape_grid is None else shape_grid
    check_cells(cells, dimension, "shape_grid")
    sweeper = make_sweeper(mechanism, settings, seed, threads, notify)
    warm_up([sweeper], sweeper.threads, shapes=cells > 0)
    design = sweeper.design(mechanism.resolve(params or {}))
    require_home(sweeper, design)
    course = begun or Sums(), keep, progress
    sweeper.cluster = cluster
    if settings.grid is not None:
        tallies, estimates = measure_on_grids(sweeper, design, settings.grid, *course)
    elif settings.target_error is not None:
        tallies, estimates = measure_to_target(sweeper, design, settings.target_error, *course)
    else:
        replicates, count = split_samples(planned_samples(settings), settings.replicates)
        points = sweeper.sequence(replicates)
        tallies = _whole(_accumulate(sweeper, design, points, count, *course))
        estimates = from_replicates(tallies)
    shape = projection = None
    if cells > 0:
        shape = measure_shape(sweeper, design, cells)
        projection = measure_projection(
            sweeper, design, min(estimates.samples, PROJECTION_SAMPLES), (estimates.volume, shape)
        )
    return _result(sweeper, design, tallies, estimates, shape, projection)


def planned_samples(settings: WorkspaceSettings) -> int:
    """Return the samples of a run that is told neither a grid nor a target error."""
    default = FIELD_SAMPLES if settings.aspect or settings.block else DEFAULT_SAMPLES
    return settings.samples or default


def _accumulate(
    sweeper: Sweeper,
    design: Design,
    points: Sequence,
    last: int,
    sums: Sums,
    keep: Keep | None,
    progress: Progress | None,
) -> Sums:
    """Go on to the points ``.. last - 1`` of every replicate, block by block in order."""
    replicates = points.replicates
    first = sums.points

    def done(count: int) -> None:
        if progress:
            progress(count * replicates, last * replicates)

    if sweeper.cluster is None:
        blocks = sweeper.blocks(design, points, first, last, done)
    else:
        blocks = blocks_on(sweeper.cluster, sweeper, design, points, first, last, done)
    for (start, stop), block in zip(block_ranges(first, last, replicates), blocks, strict=True):
        sums = sums.with_block(block, len(list(chunk_ranges(start, stop, replicates))))
        # Where a run ends within a block, one with more samples does not.
        if keep and stop % block_length(replicates) == 0:
            keep(sums)
    return sums


def _whole(sums: Sums) -> Tallies:
    assert sums.part is not None  # every range holds a point
    return sums.part


def measure_to_target(
    sweeper: Sweeper,
    design: Design,
    target: float,
    sums: Sums | None = None,
    keep: Keep | None = None,
    progress: Progress | None = None,
    most: int | None = None,
) -> tuple[Tallies, Estimates]:
    """Double the samples until volume and GCI have the relative standard error asked for.

    With few samples the error estimate itself is rough, so that the first estimate below the
    target is checked by one further doubling. At ``most`` samples it ends with what is reached.

    Raises
    ------
    PmoptError
        Without ``most``, when the largest number of samples does not do.
    """
    sums = sums or Sums()
    first = _FIRST_ON_LINES if sweeper.settings.sampler == "lines" else _FIRST_ROUND
    replicates = sweeper.settings.replicates or split_samples(first, None)[0]
    last = max(1, first // replicates // BLOCK) * BLOCK  # a later round begins a block
    while last < sums.points:
        last *= 2
    points = sweeper.sequence(replicates)
    while True:
        sums = _accumulate(sweeper, design, points, last, sums, keep, progress)
        tallies = _whole(sums)
        estimates = from_replicates(tallies)
        errors = [e.error / e.value if e.value else 0.0 for e in (estimates.volume, estimates.gci)]
        worst = max((e for e in errors if not math.isnan(e)), default=0.0)
        if max(worst, sums.worst) <= target or estimates.reachable == 0:
            return tallies, estimates
        if most is not None and 2 * last * replicates > most:
            return tallies, estimates
        if 2 * last * replicates > MAX_SAMPLES:
            raise PmoptError(
                f"target error {target} not reached with {last * replicates} samples: "
                f"the relative standard error is {worst:.2g}"
            )
        sums = replace(sums, worst=worst)
        last *= 2


def measure_on_grids(
    sweeper: Sweeper,
    design: Design,
    cells: int,
    sums: Sums | None = None,
    keep: Keep | None = None,
    progress: Progress | None = None,
) -> tuple[Tallies, Estimates]:
    """Evaluate the grid and coarser ones that tell its error."""
    dimension = len(design.width)
    check_grid(cells, dimension)
    sums = sums or Sums()
    sizes = [max(2, round(cells * ratio)) for ratio in _COARSER_GRIDS] + [cells]
    planned = sum(n**dimension for n in sizes)
    for n in sizes[len(sums.whole) :]:
        done = sum(t.points for t in sums.whole)

        def report(count: int, _: int, done: int = done) -> None:
            if progress:
                progress(done + count, planned)

        grid = make_grid(dimension, n)
        sums = _accumulate(sweeper, design, grid, n**dimension, sums, keep, report)
        sums = replace(sums, whole=(*sums.whole, _whole(sums)), part=None)
    *coarser, fine = sums.whole
    coarse = [(cells / n, t) for n, t in zip(sizes[:-1], coarser, strict=True)]
    return fine, from_grids(fine, coarse)


def _result(
    sweeper: Sweeper,
    design: Design,
    tallies: Tallies,
    estimates: Estimates,
    shape: Shape | None,
    projection: Projection | None,
) -> WorkspaceResult:
    mechanism, settings = sweeper.mechanism, sweeper.settings
    edges = settings.regions
    unit = mechanism.volume_unit
    names = [c.name for c in mechanism.pose]
    ends = zip(design.lower.tolist(), (design.lower + design.width).tolist(), strict=True)
    units = {p.name: mechanism.unit(p) for p in mechanism.parameters}
    units |= {c.name: mechanism.unit(c) for c in (*mechanism.pose, *mechanism.joints)}
    units |= {"volume": unit, "gci": ONE, "lci": ONE, "share": ONE, "min_lci": ONE}
    units |= {c.name: mechanism.unit(c) for c in mechanism.passive}
    units["characteristic_length"] = unit_of("length", mechanism.length_unit)
    units |= dict.fromkeys(
        ("link_diameter", "platform_diameter", "tool", *(c.name for c in TOOL)),
        mechanism.length_unit,
    )
    units["cone_angle"] = "rad"
    units["projected_volume"] = measure_unit(["length"] * 3, mechanism.length_unit)
    units["footprint"] = measure_unit(["length"] * 2, mechanism.length_unit)
    units["J"] = mixed_units(mechanism)
    counts: list[float] = tallies.histogram[0].sum(axis=0).tolist()
    return WorkspaceResult(
        mechanism=mechanism.name,
        params=dict(design.parameters),
        length_unit=mechanism.length_unit,
        working_mode=sweeper.working_mode,
        norm=settings.norm,
        jacobian=sweeper.jacobian,
        characteristic_length=design.length if sweeper.jacobian == "homogenized" else None,
        sampler=settings.sampler_name,
        seed=sweeper.seed,
        grid=settings.grid,
        replicates=tallies.reachable.shape[1],
        box=dict(zip(names, ends, strict=True)),
        limits=dict(design.limits),
        settings=settings,
        volume=estimates.volume,
        volume_unit=unit,
        gci=estimates.gci,
        smallest=estimates.smallest,
        largest=estimates.largest,
        quantiles=estimates.quantiles,
        regions=tuple(
            Region(low, high, volume, share)
            for low, high, volume, share in zip(
                edges[:-1],
                edges[1:],
                estimates.region_volumes,
                estimates.region_shares,
                strict=True,
            )
        ),
        samples=estimates.samples,
        reachable=estimates.reachable,
        histogram=tuple(int(v) if v.is_integer() else v for v in counts),
        shape=shape,
        projection=projection,
        units=units,
    )
