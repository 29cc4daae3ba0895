"""What pictures of a workspace show: sections through it and its surface, coloured by LCI."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmopt.analysis.reads import TOOL_NEEDS, Reads
from pmopt.analysis.regions.surface import surface_nets
from pmopt.analysis.sampling.aspects import determinants
from pmopt.analysis.sampling.cells import lattice_points
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.sampler import Sampler
from pmopt.analysis.settings import SectionSettings
from pmopt.analysis.workspace.projection import reached_positions

Measure = Callable[[NDArray[np.float64]], NDArray[np.float64]]

#: Grid on which the workspace is located within its box; odd, so that a plane is in the middle.
_LOCATE = 97
#: Located again where it fills less than this share of the box's side, at most so often in all.
_CLOSER, _MOST_CLOSER = 0.3, 3
_MOST_SECTIONS = 6
#: Settings that change a section: nothing is sampled.
READS = Reads("sections", SectionSettings, {"tool": TOOL_NEEDS})
#: A workspace counts as symmetric if mirrored areas differ by less than this share of it.
_SYMMETRIC = 0.02
#: A section shows something if it has at least this share of the largest section's area.
_INFORMATIVE = 0.5
#: A cut leaves at least this share of the width on either side, else nothing is cut away.
_CUT_MARGIN = 0.1
#: Grid cells along a voxel where a set is known by voxels.
_FINER = 2
#: Least grid cells along a short side, as a share of those along the longest.
_LEAST_CELLS = 0.25


@dataclass(frozen=True)
class Section:
    """An axis-aligned section through a workspace.

    Attributes
    ----------
    normal, normal_unit : str
        Name and unit of the coordinate that is constant.
    level : float
        Its value.
    names, units : tuple of str
        Horizontal and vertical coordinate.
    horizontal, vertical : (n,) float64
        Their values; empty where the box is.
    inside : (n, n) float64
        A continuous field, >= 0 where reachable, a row a value of the vertical coordinate.
    continued : (n, n) float64
        LCI, continued beyond the limits; 0 out of reach.
    determinant : (n, n) float64
        Normalised determinant of the inverse Jacobian: 0 at a forward or constraint singularity.
    constants : str
        Where more than one coordinate is constant, all of them in words.
    """

    normal: str
    normal_unit: str
    level: float
    names: tuple[str, str]
    units: tuple[str, str]
    horizontal: NDArray[np.float64]
    vertical: NDArray[np.float64]
    inside: NDArray[np.float64]
    continued: NDArray[np.float64]
    determinant: NDArray[np.float64]
    constants: str = ""

    @property
    def lci(self) -> NDArray[np.float64]:
        """LCI, NaN where unreachable."""
        return np.where(self.inside >= 0, self.continued, np.nan)

    @property
    def plane(self) -> str:
        """The plane in words, e.g. ``y = 0 m``."""
        return self.constants or plane(self.normal, self.level, self.normal_unit)


@dataclass(frozen=True)
class SurfaceMesh:
    """The surface of a workspace whose front half is cut away.

    Attributes
    ----------
    names, units : tuple of str
        The three coordinates.
    vertices : (V, 3) float64
    faces : (F, 4) intp
        Outward; F = 0 where nothing is reachable.
    lci : (F,) float64
        At the point of the surface that each face stands for.
    cut : str
        The plane of the cut, e.g. ``y = 0 m``; empty where nothing is cut away.
    downwards : bool
        Whether the last coordinate is drawn downwards.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    vertices: NDArray[np.float64]
    faces: NDArray[np.intp]
    lci: NDArray[np.float64]
    cut: str
    downwards: bool = False


@dataclass(frozen=True)
class _Location:
    """A box around the reachable set and, for each coordinate, a level that shows much of it."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    levels: tuple[float, ...]


def section_fields(
    sampler: Sampler, design: Design, resolution: int = 400, measure: Measure | None = None
) -> tuple[Section, ...]:
    """Return three sections, one across each of three coordinates, or some through home.

    Of two coordinates there is one, which is the workspace.

    With more coordinates than three each section shows two of them, the others at home; of five
    coordinates six pairs are shown, every one of length and every one of angles with others.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    resolution : int
        Points along each axis of a section.
    measure : callable, optional
        What is shown instead of LCI, of poses (d, N).
    """
    pose = sampler.space.mechanism.pose
    if len(pose) < 2:
        return ()
    if len(pose) != 3:
        return _sections_through_home(sampler, design, resolution, measure)
    place = _locate(sampler, design)
    sections = []
    for normal, level in enumerate(place.levels):
        across, up = (k for k in range(3) if k != normal)
        count = resolution if design.box_volume > 0 else 0
        axes = [np.linspace(place.lower[k], place.upper[k], count) for k in (across, up)]
        poses = np.empty((3, count * count))
        poses[normal] = level
        poses[across], poses[up] = (a.ravel() for a in np.meshgrid(*axes))
        inside, lci = (v.reshape(count, count) for v in _inside(sampler, design, poses))
        shown = lci if measure is None else _measured(measure, poses, inside)
        sections.append(
            Section(
                normal=pose[normal].name,
                normal_unit=sampler.space.mechanism.unit(pose[normal]),
                level=level,
                names=(pose[across].name, pose[up].name),
                units=(
                    sampler.space.mechanism.unit(pose[across]),
                    sampler.space.mechanism.unit(pose[up]),
                ),
                horizontal=axes[0],
                vertical=axes[1],
                inside=inside,
                continued=shown,
                determinant=determinants(sampler.evaluator, design, poses).reshape(count, count),
            )
        )
    return tuple(sections)


def _measured(
    measure: Measure, poses: NDArray[np.float64], inside: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the measure where poses are reachable, NaN elsewhere."""
    values = np.full(inside.size, np.nan)
    kept = inside.ravel() >= 0
    values[kept] = measure(np.ascontiguousarray(poses[:, kept]))
    return values.reshape(inside.shape)


def _sections_through_home(
    sampler: Sampler, design: Design, resolution: int, measure: Measure | None
) -> tuple[Section, ...]:
    mechanism = sampler.space.mechanism
    home = mechanism.home(design.parameters)
    pairs = list(itertools.combinations(range(len(mechanism.pose)), 2))
    if len(pairs) > _MOST_SECTIONS:
        # Neighbours first, (x, y), (alpha, beta), .., then those a step further apart.
        pairs = sorted(sorted(pairs, key=lambda p: (p[1] - p[0], p))[:_MOST_SECTIONS])
    sections = []
    for across, up in pairs:
        low, high = design.lower, design.lower + design.width
        for count in (_LOCATE, resolution):
            axes = [np.linspace(low[k], high[k], count) for k in (across, up)]
            poses = np.repeat(np.array([list(home.values())]).T, count * count, axis=1)
            poses[across], poses[up] = (a.ravel() for a in np.meshgrid(*axes))
            inside, lci = (v.reshape(count, count) for v in _inside(sampler, design, poses))
            if count == _LOCATE and (inside >= 0).any():
                rows, columns = np.nonzero(inside >= 0)
                low, high = low.copy(), high.copy()
                for k, some, axis in ((across, columns, axes[0]), (up, rows, axes[1])):
                    low[k] = axis[max(some.min() - 2, 0)]
                    high[k] = axis[min(some.max() + 2, count - 1)]
        constants = [
            f"{c.name} = {home[c.name]:.4g} {mechanism.unit(c)}"
            for k, c in enumerate(mechanism.pose)
            if k not in (across, up)
        ]
        sections.append(
            Section(
                normal="",
                normal_unit="",
                level=0.0,
                names=(mechanism.pose[across].name, mechanism.pose[up].name),
                units=(mechanism.unit(mechanism.pose[across]), mechanism.unit(mechanism.pose[up])),
                horizontal=axes[0],
                vertical=axes[1],
                inside=inside,
                continued=lci if measure is None else _measured(measure, poses, inside),
                determinant=determinants(sampler.evaluator, design, poses).reshape(count, count),
                constants=",\n".join(
                    ", ".join(constants[i : i + 2]) for i in range(0, len(constants), 2)
                )
                or "all poses",
            )
        )
    return tuple(sections)


def surface_field(sampler: Sampler, design: Design, cells: int = 192) -> SurfaceMesh | None:
    """Return the surface behind a cut across the second coordinate; None unless there are three.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    cells : int
        Grid cells along the longest side.
    """
    mechanism = sampler.space.mechanism
    if len(mechanism.pose) != 3:
        return None
    place = _locate(sampler, design)
    lower, width, level = place.lower.copy(), place.upper - place.lower, place.levels[1]
    units = tuple(mechanism.unit(c) for c in mechanism.pose)
    cut = ""
    if abs((level - lower[1]) / (width[1] or 1.0) - 0.5) <= 0.5 - _CUT_MARGIN:
        cut = plane(mechanism.pose[1].name, level, units[1])
        # Starting the grid at the cut makes the cut a face of the box, flat and exactly in place.
        lower[1] = level
    vertices, faces, points = np.empty((0, 3)), np.empty((0, 4), dtype=np.intp), np.empty((0, 3))
    if design.box_volume > 0:
        sides = place.upper - lower
        # As they are drawn: the longest side of each unit alike.
        longest = [max(s for s, u in zip(sides, units, strict=True) if u == unit) for unit in units]
        counts = np.ceil(cells * np.maximum(sides / longest, _LEAST_CELLS)) + 1
        axes = [
            np.linspace(a, b, int(n)) for a, b, n in zip(lower, place.upper, counts, strict=True)
        ]
        net = surface_nets(lambda p: _inside(sampler, design, p)[0], axes)
        vertices, faces, points = net.vertices, net.faces, net.crossings
    return SurfaceMesh(
        names=tuple(c.name for c in mechanism.pose),
        units=units,
        vertices=vertices,
        faces=faces,
        lci=_inside(sampler, design, np.ascontiguousarray(points.T))[1],
        cut=cut,
    )


def position_field(sampler: Sampler, design: Design) -> SurfaceMesh | None:
    """Return the surface of the positions reached, cut open, with the largest LCI met there.

    Known by voxels, it is smoothed over about one.

    None for a mechanism whose pose is a position: its workspace shows them.

    Parameters
    ----------
    sampler : Sampler
    design : Design
    """
    mechanism = sampler.space.mechanism
    if all(c.kind == "length" for c in mechanism.pose):
        return None
    order = [k for k in range(3) if k != mechanism.vertical] + [mechanism.vertical]
    names = tuple("xyz"[k] for k in order)
    units = (mechanism.length_unit,) * 3
    downwards = mechanism.vertical == 0
    nothing = SurfaceMesh(names, units, np.empty((0, 3)), np.empty((0, 4), dtype=np.intp),
                          np.empty(0), "", downwards)  # fmt: skip
    if design.box_volume == 0:
        return nothing
    found = reached_positions(sampler, design)
    if found is None:
        return nothing
    lower, step = found.lower[order], found.step
    best = found.best.transpose(order)
    full = np.isfinite(best)
    axes = [lower[k] + step / _FINER * np.arange(_FINER * (n - 1) + 1)
            for k, n in enumerate(full.shape)]  # fmt: skip
    ends = lower[1] + step * np.flatnonzero(np.asarray(full.any(axis=(0, 2))))[[0, -1]]
    level = round_level(float(ends.mean()), max(float(np.ptp(ends)), step))
    # What is in front of the cut is left out.
    axes[1] = np.concatenate([[level], axes[1][axes[1] > level + step / 10]])
    from scipy import ndimage

    # Smoothed, steps of voxels become a surface; the second term keeps sheets of one voxel.
    wide, narrow = (ndimage.gaussian_filter(full.astype(float), s) for s in (1.0, 0.5))
    smooth = np.maximum(wide, 0.75 * narrow) - 0.5

    def sampled(values: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        place = (points - lower[:, None]) / step
        return np.asarray(ndimage.map_coordinates(values, place, order=1, mode="nearest"))

    net = surface_nets(lambda p: sampled(smooth, p), axes)
    # The surface passes between voxels reached and others: these take the nearest one's value.
    around = ndimage.distance_transform_edt(~full, return_distances=False, return_indices=True)
    lci = sampled(best[tuple(around)], net.crossings.T)
    return SurfaceMesh(
        names, units, net.vertices, net.faces, lci,
        plane(names[1], level, units[1]), downwards,
    )  # fmt: skip


def plane(name: str, level: float, unit: str) -> str:
    """Return what a plane is called."""
    return f"{name} = {level:.6g} {unit}"


def _inside(
    sampler: Sampler, design: Design, poses: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a field that is >= 0 where margin and LCI allow a pose, and the LCI."""
    margin, lci = sampler.evaluator.field(design, poses)
    least = sampler.space.settings.min_lci
    if least == 0:
        return margin, lci
    # As large as the margin, neither part dominates where the field is interpolated; the size is
    # the same wherever it is asked for.
    return np.minimum(margin, float(design.width.max()) * (lci - least)), lci


def _locate(sampler: Sampler, design: Design) -> _Location:
    """Find what is reachable within a design's box."""
    lower, upper = design.lower, design.lower + design.width
    place = _Location(lower, upper, tuple(((lower + upper) / 2).tolist()))
    for _ in range(_MOST_CLOSER if design.box_volume > 0 else 0):
        axes = np.linspace(place.lower, place.upper, _LOCATE, axis=1)
        inside, _ = _inside(sampler, design, lattice_points(axes))
        reachable = (inside >= 0).reshape((_LOCATE,) * 3)
        if not reachable.any():
            break
        first, last = np.empty(3), np.empty(3)
        levels = []
        for k, planes in enumerate(axes):
            areas = reachable.sum(axis=tuple(i for i in range(3) if i != k)).astype(float)
            some = np.flatnonzero(areas)
            # The boundary lies up to a step beyond the outermost reachable points.
            first[k] = planes[max(some[0] - 1, 0)]
            last[k] = planes[min(some[-1] + 1, _LOCATE - 1)]
            levels.append(_level(planes, areas))
        wide = place.upper - place.lower
        place = _Location(first, last, tuple(levels))
        if ((last - first) > _CLOSER * wide).all():
            break
    return place


def _level(planes: NDArray[np.float64], areas: NDArray[np.float64]) -> float:
    """Choose where to cut: the middle of a symmetric workspace, else its centroid, rounded.

    A plane that meets little of the workspace gives way to the one that meets most.
    """
    first, last = float(planes[0]), float(planes[-1])
    largest = float(planes[np.argmax(areas)])
    if np.abs(areas - areas[::-1]).sum() <= _SYMMETRIC * areas.sum():
        level = (first + last) / 2
    else:
        level = float((planes * areas).sum() / areas.sum())
    for choice in (round_level(level, last - first), round_level(largest, last - first)):
        if np.interp(choice, planes, areas) >= _INFORMATIVE * areas.max():
            return choice
    return round_level(largest, last - first, 100)


def round_level(value: float, width: float, finer: int = 1) -> float:
    """Return a value rounded to a twentieth of the power of ten below a width, or finer."""
    power = math.floor(math.log10(width))
    # Divided by a whole number, or by a power of ten, it has few digits as text too.
    steps = round(value * 20 * finer / 10.0**power)
    return float(f"{steps * 10.0**power / (20 * finer):.12g}") + 0.0
