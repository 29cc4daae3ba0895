"""Volume, dexterity and shape of a workspace, each number with its error estimate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.kinematics.index_units import entry_units, index_note
from pmopt.analysis.reads import TOOL_NEEDS, Reads, tool_is_read
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.design_space import TOOL
from pmopt.analysis.sampling.estimates import QUANTILES, Estimates
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.measuring import Course, measure_as_set
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import (
    Tallies,
)
from pmopt.analysis.sampling.warmup import warm_up
from pmopt.analysis.settings import (
    WorkspaceSettings,
)
from pmopt.analysis.workspace.emptiness import require_home
from pmopt.analysis.workspace.extremes import find_extremes
from pmopt.analysis.workspace.projection import PROJECTION_SAMPLES, Projection, measure_projection
from pmopt.analysis.workspace.shape import DEFAULT_GRIDS, Shape, check_cells, measure_shape
from pmopt.mechanisms.mechanism import JacobianKind, Mechanism
from pmopt.numerics.bins import bin_edges
from pmopt.quantity import Quantity
from pmopt.units import ONE, measure_unit, unit_of

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class Region:
    """A dexterity region: LCI in [lower, upper), the last one closed."""

    lower: float
    upper: float
    volume: Quantity
    share: Quantity


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
    volume: Quantity
    volume_unit: str
    gci: Quantity
    smallest: Quantity
    largest: Quantity
    quantiles: tuple[Quantity, ...]
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
        found: Quantity = getattr(self.projection, name)
        # Where poses are positions, volume and error are those of the workspace.
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
    notify: Notify | None = None,
    course: Course | None = None,
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
    notify : callable, optional
        Receives a line when kernels have to be compiled.
    course : Course, optional
        Where the sums begin, who is given them as they grow, and who computes them.

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
    sampler = make_sampler(mechanism, settings, seed, threads, notify)
    warm_up([sampler.evaluator], sampler.threads, shapes=cells > 0, extremes=True)
    design = sampler.design(mechanism.resolve(params or {}))
    require_home(sampler.evaluator, design)
    tallies, estimates = measure_as_set(sampler, design, course)
    estimates = estimates.in_unit(mechanism.volume_unit, bounded=settings.grid is not None)
    shape = projection = None
    if cells > 0:
        shape = measure_shape(sampler.evaluator, design, cells)
        projection = measure_projection(
            sampler, design, min(estimates.samples, PROJECTION_SAMPLES), (estimates.volume, shape)
        )
    extremes = find_extremes(sampler, design, estimates.smallest, estimates.largest)
    return WorkspaceResult(
        subject=sampler.space.subject(design),
        norm=settings.norm,
        jacobian=sampler.space.jacobian,
        characteristic_length=design.length if sampler.space.jacobian == "homogenized" else None,
        sampler=settings.sampler_name,
        seed=sampler.seed,
        grid=settings.grid,
        replicates=tallies.reachable.shape[1],
        settings=settings,
        volume=estimates.volume,
        volume_unit=mechanism.volume_unit,
        gci=estimates.gci,
        smallest=extremes[0],
        largest=extremes[1],
        quantiles=estimates.quantiles,
        regions=_regions(settings, estimates),
        samples=estimates.samples,
        reachable=estimates.reachable,
        histogram=_counts(tallies),
        shape=shape,
        projection=projection,
        units=_units(mechanism, settings),
    )


def _regions(settings: WorkspaceSettings, estimates: Estimates) -> tuple[Region, ...]:
    edges, found = settings.regions, (estimates.region_volumes, estimates.region_shares)
    return tuple(
        Region(low, high, volume, share)
        for low, high, volume, share in zip(edges[:-1], edges[1:], *found, strict=True)
    )


def _counts(tallies: Tallies) -> tuple[float, ...]:
    """Return the histogram of all replicates; whole numbers but for points on lines."""
    counts: list[float] = tallies.histogram[0].sum(axis=0).tolist()
    return tuple(int(v) if v.is_integer() else v for v in counts)


def check_read(settings: WorkspaceSettings, shape_grid: int) -> None:
    """Refuse what changes nothing: all settings are read, but some not without the shape.

    Raises
    ------
    InputError
    """
    if shape_grid > 0:
        return
    Reads("workspace", WorkspaceSettings, {
        "tool": (f"{TOOL_NEEDS[0]}, or with shape_grid > 0", tool_is_read),
    }).check(settings)  # fmt: skip


def _units(mechanism: Mechanism, settings: WorkspaceSettings) -> dict[str, str]:
    """Return the unit of every number of a result."""
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
    return units
