"""Volume, dexterity and shape of a workspace, each number with its error estimate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.index_units import entry_units, index_note
from pmopt.analysis.reads import TOOL_NEEDS, Reads, tool_is_read
from pmopt.analysis.record import OfSubject
from pmopt.analysis.settings import (
    DEFAULT_REPLICATES,
    DEFAULT_SAMPLES,
    MAX_SAMPLES,
    WorkspaceSettings,
    split_samples,
)
from pmopt.analysis.workspace.aspects import make_sweeper, require_home
from pmopt.analysis.workspace.blocks import blocks_on
from pmopt.analysis.workspace.estimates import (
    QUANTILES,
    Estimate,
    Estimates,
    from_grid,
    from_replicates,
)
from pmopt.analysis.workspace.extremes import Extreme, find_extremes
from pmopt.analysis.workspace.partial_sums import Sums
from pmopt.analysis.workspace.projection import PROJECTION_SAMPLES, Projection, measure_projection
from pmopt.analysis.workspace.shape import DEFAULT_GRIDS, Shape, check_cells, measure_shape
from pmopt.analysis.workspace.sweeper import (
    BLOCK_CHUNKS,
    TOOL,
    Design,
    Notify,
    Sweeper,
    Tallies,
    block_length,
    block_ranges,
    check_grid,
)
from pmopt.analysis.workspace.warmup import warm_up
from pmopt.errors import PmoptError
from pmopt.mechanisms.mechanism import JacobianKind, Mechanism
from pmopt.numerics.bins import bin_edges
from pmopt.numerics.sequences import BLOCK, Sequence, make_grid
from pmopt.units import ONE, measure_unit, unit_of

if TYPE_CHECKING:
    from pmopt.execution.cluster import Cluster

#: Called with points done and points planned.
Progress = Callable[[int, int], None]
#: Called with what has been summed after every whole block: to go on from it another time.
Keep = Callable[[Sums], None]

DEFAULT_SEED = 1
#: Least samples that a grid is compared with.
_LEAST_COMPARED = 1 << 14
#: On the way to a target error: replicates (that an error estimate be less by chance where it is
#: looked at again and again), samples of the first round, reachable ones that an error estimate
#: needs, and samples none of which is reachable that end the search.
_TARGET_REPLICATES = 32
_FIRST_ROUND = 1 << 10
_ENOUGH_REACHABLE = 64
_ALL_IN_VAIN = 1 << 18
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
class WorkspaceResult(OfSubject):
    """A workspace: every number in the unit that ``units`` gives."""

    norm: str
    jacobian: JacobianKind
    characteristic_length: float | None
    sampler: str
    seed: int
    grid: int | None
    replicates: int
    settings: WorkspaceSettings
    volume: Estimate
    volume_unit: str
    gci: Estimate
    smallest: Extreme
    largest: Extreme
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
        """What the index is of, and whether it mixes units."""
        note = index_note(
            self.jacobian, self.characteristic_length, self.length_unit, self.units["J"]
        )
        return f"{self.settings.block} rows of the {note}" if self.settings.block else note

    @property
    def error_name(self) -> str:
        """What the errors beside values are: ``standard_error``, of a grid ``error_bound``."""
        return "error_bound" if self.grid else "standard_error"

    @property
    def histogram_edges(self) -> NDArray[np.float64]:
        """The edges of the histogram's bins, one more than these."""
        return bin_edges()

    def _projected(self, name: str, unit: str) -> dict[str, Any] | None:
        if self.projection is None:
            return None
        found: Estimate = getattr(self.projection, name)
        # Where poses are positions the volume is the workspace's own, and so is its error.
        error = self.error_name if found is self.volume else "standard_error"
        entry: dict[str, Any] = {
            "value": number(found.value),
            "unit": self.units[unit],
            error: number(found.error),
        }
        if name == "volume" and self.projection.lower:
            entry["bound"] = "lower"
        return entry

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        quantiles = dict(zip(map(str, QUANTILES), self.quantiles, strict=True))
        error = self.error_name
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
                "error_estimate": "comparison" if self.grid else "replicates",
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
                error: number(self.volume.error),
            },
            "gci": {"value": number(self.gci.value), error: number(self.gci.error)},
            "lci": {
                "min": number(self.smallest.value),
                "max": number(self.largest.value),
                "min_bound": self.smallest.bound,
                "max_bound": self.largest.bound,
                "mean": number(self.gci.value),
                error: number(self.gci.error),
                "quantiles": {q: number(e.value) for q, e in quantiles.items()},
                "quantile_errors": {q: number(e.error) for q, e in quantiles.items()},
            },
            "regions": [
                {
                    "lower": r.lower,
                    "upper": r.upper,
                    "volume": number(r.volume.value),
                    "share": number(r.share.value),
                    f"volume_{error}": number(r.volume.error),
                    f"share_{error}": number(r.share.error),
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
        coordinates, see :data:`pmopt.analysis.workspace.shape.DEFAULT_GRIDS`); 0 leaves the shape
        out, and the positions reached with it.
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
    check_read(settings, cells)
    sweeper = make_sweeper(mechanism, settings, seed, threads, notify)
    warm_up([sweeper], sweeper.threads, shapes=cells > 0, extremes=True)
    design = sweeper.design(mechanism.resolve(params or {}))
    require_home(sweeper, design)
    course = begun or Sums(), keep, progress
    sweeper.cluster = cluster
    if settings.grid is not None:
        tallies, estimates = measure_on_grid(sweeper, design, settings.grid, *course)
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
    extremes = find_extremes(sweeper, design, estimates.smallest, estimates.largest)
    return _result(sweeper, design, tallies, estimates, extremes, shape, projection)


def check_read(settings: WorkspaceSettings, shape_grid: int) -> None:
    """Refuse what changes nothing: all settings are read, but some not without the shape.

    Raises
    ------
    InputError
    """
    if shape_grid > 0:
        return
    Reads("workspace", frozenset(type(settings).model_fields), {
        "tool": (f"{TOOL_NEEDS[0]}, or with shape_grid > 0", tool_is_read),
    }).check(settings)  # fmt: skip


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
        # A chunk that rounds of a target error share is counted once it is whole.
        length = block_length(replicates) // BLOCK_CHUNKS
        sums = sums.with_block(block, stop // length - start // length)
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

    At ``most`` samples it ends with what is reached.

    Raises
    ------
    PmoptError
        Without ``most``, when the largest number of samples does not do.
    """
    sums = sums or Sums()
    replicates = sweeper.settings.replicates or _TARGET_REPLICATES
    # A power of two, and once a block is reached whole blocks, as Sobol' points need them.
    last = 1 << max(4, math.ceil(math.log2(_FIRST_ROUND / replicates)))
    while last < sums.points:
        last *= 2
    points = sweeper.sequence(replicates)
    while True:
        if sums.points % BLOCK:
            sums = Sums()  # less than a block: again from its beginning
        sums = _accumulate(sweeper, design, points, last, sums, keep, progress)
        tallies = _whole(sums)
        estimates = from_replicates(tallies)
        errors = [e.error / e.value if e.value else 0.0 for e in (estimates.volume, estimates.gci)]
        worst = max((e for e in errors if not math.isnan(e)), default=0.0)
        if worst <= target and estimates.reachable >= _ENOUGH_REACHABLE:
            return tallies, estimates
        samples = last * replicates
        if estimates.reachable == 0 and samples >= _ALL_IN_VAIN:
            return tallies, estimates
        if most is not None and 2 * samples > most:
            return tallies, estimates
        if 2 * samples > MAX_SAMPLES:
            raise PmoptError(
                f"target error {target} not reached with {samples} samples: "
                f"the relative standard error is {worst:.2g}"
            )
        last *= 2


def measure_on_grid(
    sweeper: Sweeper,
    design: Design,
    cells: int,
    sums: Sums | None = None,
    keep: Keep | None = None,
    progress: Progress | None = None,
) -> tuple[Tallies, Estimates]:
    """Evaluate a grid and as many independent samples, that bound its error."""
    dimension = len(design.width)
    check_grid(cells, dimension)
    sums = sums or Sums()
    count = cells**dimension
    replicates, each = split_samples(max(count, _LEAST_COMPARED), DEFAULT_REPLICATES)
    samples = replicates * each

    def report(done: int) -> Progress:
        return lambda points, _: progress(done + points, samples + count) if progress else None

    if not sums.whole:
        points = sweeper.sequence(replicates)
        sums = _accumulate(sweeper, design, points, each, sums, keep, report(0))
        sums = replace(sums, whole=(_whole(sums),), part=None)
    grid = make_grid(dimension, cells)
    sums = _accumulate(sweeper, design, grid, count, sums, keep, report(samples))
    tallies = _whole(sums)
    return tallies, from_grid(tallies, sums.whole[0])


def _result(
    sweeper: Sweeper,
    design: Design,
    tallies: Tallies,
    estimates: Estimates,
    extremes: tuple[Extreme, Extreme],
    shape: Shape | None,
    projection: Projection | None,
) -> WorkspaceResult:
    mechanism, settings = sweeper.mechanism, sweeper.settings
    edges = settings.regions
    unit = mechanism.volume_unit
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
    units["J"] = entry_units(mechanism, settings.block)
    counts: list[float] = tallies.histogram[0].sum(axis=0).tolist()
    return WorkspaceResult(
        subject=sweeper.subject(design),
        norm=settings.norm,
        jacobian=sweeper.jacobian,
        characteristic_length=design.length if sweeper.jacobian == "homogenized" else None,
        sampler=settings.sampler_name,
        seed=sweeper.seed,
        grid=settings.grid,
        replicates=tallies.reachable.shape[1],
        settings=settings,
        volume=estimates.volume,
        volume_unit=unit,
        gci=estimates.gci,
        smallest=extremes[0],
        largest=extremes[1],
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
