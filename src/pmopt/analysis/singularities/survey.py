"""Where a workspace is singular: how near it comes, along which families, into which aspects.

Inverse singularities (type I, Gosselin and Angeles 1990) lose a freedom at the end of a limb's
reach, forward ones (type II) gain one that the actuated joints do not hold, constraint ones gain
one that the limbs' constraints do not hold.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pmopt.analysis.kinematics.conditioning import homogenize
from pmopt.analysis.kinematics.determinants import KINDS, branch_at, measures_at
from pmopt.analysis.kinematics.inverse import Inverting
from pmopt.analysis.kinematics.limits import of_limb
from pmopt.analysis.reads import TOOL_NEEDS, Reads
from pmopt.analysis.record import OfSubject
from pmopt.analysis.sampling.aspects import AspectMap, determinants, determinants_along, map_aspects
from pmopt.analysis.sampling.design_space import Design
from pmopt.analysis.sampling.evaluator import Notify
from pmopt.analysis.sampling.sampler import Sampler, make_sampler
from pmopt.analysis.sampling.warmup import warm_up
from pmopt.analysis.settings import SingularitySettings, WorkspaceSettings, split_samples
from pmopt.analysis.singularities.families import Family, find_families
from pmopt.analysis.singularities.touching import Values, least_along
from pmopt.analysis.workspace.emptiness import nothing_reachable, require_reachable
from pmopt.analysis.workspace.projection import replicate
from pmopt.mechanisms.mechanism import Mechanism, Parameters, Vector
from pmopt.numerics.matrices import determinant, singular_values, solve
from pmopt.quantity import Quantity
from pmopt.units import ONE

DEFAULT_SAMPLES = 1 << 18
#: Settings that change what is found; its own grid is that of the aspects.
READS = Reads(
    "singularities",
    SingularitySettings,
    {"tool": TOOL_NEEDS},
)
#: Aspects of less than this share of the workspace are specks of the grid.
_SPECK = 1e-3
#: Reachable poses at which each limb's measures are evaluated one by one.
_PROBES = 400
#: Steps of the scan along a coordinate, and how near zero a measure is at a limb's end of reach,
#: where it falls with the root of the distance.
_STEPS = 720
#: A determinant this small is 0.
_TOUCHES = 1e-13
_ENDS = 1e-4

#: Zeros that are located of each measure that changes sign, what counts as one, and how little a
#: coordinate may differ between them to be called the same.
_ZEROS, _ZERO, _SAME = 12, 1e-9, 1e-7
#: How far a scan goes beyond the box of what can be reached, as a share of its width.
_BEYOND = 0.02


@dataclass(frozen=True)
class Nearness:
    """How near the sampled workspace comes to one kind of singularity of one limb.

    ``condition`` says where the normalised determinant vanishes, ``smallest`` is its least
    absolute value met, 0 where it is crossed; ``negative`` the share of poses where it is negative.
    ``always`` are coordinates, or their sizes as ``|name|``, that are the same at every one of
    ``located`` zeros between poses of either sign.
    """

    kind: str
    part: str
    condition: str
    smallest: float
    negative: float
    crossed: bool
    located: int
    always: dict[str, float]


@dataclass(frozen=True)
class Wall:
    """Where a straight line from the home pose along one coordinate first ends or is singular."""

    coordinate: str
    direction: int
    value: float
    what: str
    values: dict[str, float]


@dataclass(frozen=True)
class Aspect:
    """A connected region without forward or constraint singularities."""

    sign: int
    volume: Quantity
    share: Quantity
    home: bool


@dataclass(frozen=True)
class SingularityResult(OfSubject):
    """What :func:`find_singularities` found."""

    home: dict[str, float]
    home_lci: float
    jacobian: str
    characteristic_length: float | None
    smallest_lci: Quantity
    smallest_singular_value: Quantity
    nearness: tuple[Nearness, ...]
    families: tuple[Family, ...]
    walls: tuple[Wall, ...]
    aspects: tuple[Aspect, ...]
    specks: int
    confirmed: bool
    grid: int
    samples: int
    reachable: int
    seed: int
    volume_unit: str
    units: dict[str, str]

    def to_dict(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "mechanism": self.mechanism,
            "params": self.params,
            "working_mode": self.working_mode,
            "home": {"pose": self.home, "lci": self.home_lci},
            "jacobian": self.jacobian,
            "characteristic_length": self.characteristic_length,
            "nearest": {
                "smallest_lci": self.smallest_lci.value,
                "smallest_singular_value": self.smallest_singular_value.value,
                "measures": [asdict(n) for n in self.nearness],
            },
            "families": [{**asdict(f), "free": list(f.free)} for f in self.families],
            "walls": [asdict(w) for w in self.walls],
            "aspects": [
                {
                    "sign": a.sign,
                    "volume": a.volume.value,
                    "volume_standard_error": a.volume.error,
                    "share": a.share.value,
                    "share_standard_error": a.share.error,
                    "home": a.home,
                }
                for a in self.aspects
            ],
            "specks": self.specks,
            "confirmed": self.confirmed,
            "grid": self.grid,
            "samples": self.samples,
            "reachable": self.reachable,
            "seed": self.seed,
            "units": self.units,
        }


def find_singularities(
    mechanism: Mechanism,
    params: Mapping[str, Any] | None = None,
    settings: WorkspaceSettings | None = None,
    *,
    seed: int = 1,
    threads: int | None = None,
    grid: int | None = None,
    notify: Notify | None = None,
) -> SingularityResult:
    """Map the singularities of one design over its workspace.

    Parameters
    ----------
    mechanism : Mechanism
    params : mapping, optional
        Design parameters; those left out take their defaults.
    settings : WorkspaceSettings, optional
        ``samples`` are the poses behind the volumes of aspects; :data:`READS` lists what is read.
    seed : int
    threads : int, optional
        The result is the same for any number.
    grid : int, optional
        Cells along each axis on which aspects are distinguished.
    notify : callable, optional

    Raises
    ------
    InputError
        For settings that are not read.
    InfeasibleError
        When nothing is reachable, with what rules it out.
    """
    settings = settings or WorkspaceSettings()
    READS.check(settings)
    sampler = make_sampler(mechanism, settings, seed, threads, notify, where="singularities")
    warm_up([sampler.evaluator, Inverting(mechanism)], sampler.threads)
    design = sampler.design(mechanism.resolve(params or {}))
    if design.box_volume == 0:
        raise nothing_reachable(mechanism, design.parameters, settings, "singularities")
    found = map_aspects(sampler.evaluator, design, grid)
    coarse = map_aspects(sampler.evaluator, design, max(4, round(found.cells * 2 / 3)))
    replicates, count = split_samples(settings.samples or DEFAULT_SAMPLES, settings.replicates)
    points = sampler.sequence(replicates)
    labels = np.zeros((replicates, len(found.counts) + 1))
    reached, smallest, some = np.zeros(replicates), math.inf, []
    for r in range(replicates):
        poses = sampler.evaluator.points(design, replicate(points, r), 0, count)
        margin, lci = sampler.evaluator.field(design, poses)
        kept = (margin >= 0) & (lci >= settings.min_lci)
        poses = poses[:, kept]
        reached[r] = poses.shape[1]
        some.append(poses[:, : -(-_PROBES // replicates)])
        if poses.shape[1]:
            smallest = min(smallest, float(lci[kept].min()))
            members = found.of(poses, determinants(sampler.evaluator, design, poses))
            labels[r] = np.bincount(members, minlength=labels.shape[1])
    require_reachable(
        int(reached.sum()), mechanism, design.parameters, settings, "singularities",
        replicates * count,
    )  # fmt: skip
    home = mechanism.home(design.parameters)
    here = np.array([list(home.values())]).T
    margin, lci = sampler.evaluator.field(design, here)
    inside = bool(margin[0] >= 0)
    own = int(found.of(here, determinants(sampler.evaluator, design, here))[0]) if inside else 0
    columns = np.concatenate(some, axis=1).T.tolist()
    probes = [dict(zip(home, column, strict=True)) for column in columns]
    nearness, least = _nearness(sampler, design, probes)
    aspects, specks = _aspects((design, mechanism.volume_unit), found, labels, reached, count, own)
    units = {c.name: mechanism.unit(c) for c in (*mechanism.pose, *mechanism.joints)}
    units |= {c.name: mechanism.unit(c) for c in (*mechanism.passive, *mechanism.parasitic)}
    units |= {p.name: mechanism.unit(p) for p in mechanism.parameters}
    units |= {"volume": mechanism.volume_unit, "share": ONE, "lci": ONE, "smallest": ONE}
    units |= {"characteristic_length": mechanism.length_unit, "smallest_singular_value": ONE}
    return SingularityResult(
        subject=sampler.space.subject(design),
        home=home,
        home_lci=float(lci[0]) if inside else 0.0,
        jacobian=sampler.space.jacobian,
        characteristic_length=design.length if sampler.space.jacobian == "homogenized" else None,
        smallest_lci=Quantity(smallest, 0.0, sign="<="),
        smallest_singular_value=Quantity(least, 0.0, sign="<="),
        nearness=nearness,
        families=find_families(sampler, design),
        walls=_walls(sampler, design, home) if inside else (),
        aspects=aspects,
        specks=specks,
        confirmed=_large(found) == _large(coarse),
        grid=found.cells,
        samples=replicates * count,
        reachable=int(reached.sum()),
        seed=seed,
        volume_unit=mechanism.volume_unit,
        units=units,
    )


def _large(found: AspectMap) -> int:
    """Return the number of aspects that are no specks."""
    return sum(c >= _SPECK * sum(found.counts) for c in found.counts)


def _aspects(
    of: tuple[Design, str],
    found: AspectMap,
    labels: np.ndarray[Any, np.dtype[np.float64]],
    reached: Vector,
    count: int,
    own: int,
) -> tuple[tuple[Aspect, ...], int]:
    """Return the aspects with their volumes, in a unit, and how many are specks."""
    (design, unit), replicates = of, len(reached)
    aspects = []
    for number in range(1, _large(found) + 1):
        hits = labels[:, number]
        volumes = design.box_volume * hits / count
        share = hits.sum() / reached.sum()
        # Linearised error of a ratio of sums over replicates.
        residual = (hits - share * reached) / reached.mean()
        scale = math.sqrt(replicates * (replicates - 1))
        aspects.append(
            Aspect(
                found.signs[number - 1],
                Quantity(
                    float(volumes.mean()),
                    max(float(np.sqrt(((volumes - volumes.mean()) ** 2).sum())) / scale,
                        design.box_volume / (count * replicates)),
                    unit,
                ),
                Quantity(float(share), float(np.sqrt((residual**2).sum())) / scale),
                number == own,
            )
        )  # fmt: skip
    return tuple(aspects), len(found.counts) - len(aspects)


def _nearness(
    sampler: Sampler, design: Design, probes: list[dict[str, float]]
) -> tuple[tuple[Nearness, ...], float]:
    """Return the least of each measure over some poses, and the least singular value."""
    mechanism, parameters = sampler.space.mechanism, design.parameters
    rows, poses, maps = [], [], []
    least = math.inf
    for pose, branches in zip(probes, mechanism.inverses(parameters, probes), strict=True):
        branch = next((b for b in branches if b.working_mode == sampler.space.working_mode), None)
        if branch is None:
            continue
        found = mechanism.singularity_measures(parameters, pose, branch.joints)
        poses.append(pose)
        rows.append({(k, part): v for k, parts in found.items() for part, v in parts.items()})
        j_x, j_q = mechanism.velocity_maps(parameters, pose, branch.joints)
        maps.append((j_x, j_q))
    if maps:
        j_x, j_q = (np.stack(parts) for parts in zip(*maps, strict=True))
        regular = determinant(j_x) != 0
        length = mechanism.characteristic_length(parameters)
        scaled = homogenize(mechanism, solve(j_x[regular], j_q[regular]), length)
        values = singular_values(scaled)[:, -1]
        least = float(values.min()) if regular.all() else 0.0
    result = []
    for kind, part in rows[0] if rows else ():
        values = np.array([row[kind, part] for row in rows])
        crossed = bool(values.min() < 0 < values.max())
        zeros = _zeros(sampler, parameters, (kind, part), poses, values) if crossed else []
        result.append(
            Nearness(kind, part, mechanism.condition(kind, part),
                     0.0 if crossed else float(np.abs(values).min()),
                     float((values < 0).mean()), crossed, len(zeros), _always(zeros))
        )  # fmt: skip
    return tuple(result), least


def _zeros(
    sampler: Sampler,
    parameters: Parameters,
    key: tuple[str, str],
    poses: list[dict[str, float]],
    values: Vector,
) -> list[dict[str, float]]:
    """Return all coordinates at zeros of a measure, each between two poses of either sign."""
    ends = zip(np.flatnonzero(values > 0), np.flatnonzero(values < 0), strict=False)
    zeros = []
    for positive, negative in itertools.islice(ends, _ZEROS):
        a, b = poses[positive], poses[negative]
        pose, value = a, math.inf
        for _ in range(52):
            pose = {k: (a[k] + b[k]) / 2 for k in a}
            found = measures_at(
                sampler.space.mechanism, sampler.space.working_mode, parameters, pose
            )
            if found is None:
                break
            value = found[key]
            a, b = (pose, b) if value > 0 else (a, pose)
        branch = branch_at(sampler.space.mechanism, sampler.space.working_mode, parameters, pose)
        # The line between the poses may leave the reach, or meet a jump of the measure.
        if branch is not None and abs(value) < _ZERO:
            zeros.append({**pose, **branch.joints, **branch.parasitic, **branch.passive})
    return zeros


def _always(zeros: list[dict[str, float]]) -> dict[str, float]:
    """Return what some points have in common: coordinates, or their sizes as ``|name|``."""
    if len(zeros) < _ZEROS // 2:
        return {}
    found = {}
    for name in zeros[0]:
        values = np.array([zero[name] for zero in zeros])
        if np.ptp(values) <= _SAME:
            found[name] = float(values.mean())
        elif np.ptp(np.abs(values)) <= _SAME:
            found[f"|{name}|"] = float(np.abs(values).mean())
    return found


def _kind_at(sampler: Sampler, parameters: Parameters, pose: Mapping[str, float]) -> str:
    """Return the kind of the measure that is smallest at a singular pose."""
    measures = measures_at(sampler.space.mechanism, sampler.space.working_mode, parameters, pose)
    if not measures:
        return "inverse"
    return min(measures, key=lambda key: abs(measures[key]))[0]


def _walls(sampler: Sampler, design: Design, home: Mapping[str, float]) -> tuple[Wall, ...]:
    """Follow every coordinate from home, both ways, to the first singularity or end of reach."""
    walls = []
    for k, coordinate in enumerate(sampler.space.mechanism.pose):
        low, high = design.lower[k], design.lower[k] + design.width[k]
        for direction, end in ((-1, low), (1, high)):
            if (end - home[coordinate.name]) * direction <= 0:
                continue
            side = (direction + 1) // 2
            if design.cut[k, side]:
                end = design.given[coordinate.name][side]
            else:
                end += direction * _BEYOND * (high - low)  # reach ends by itself: go and see
            walls.append(_wall(sampler, design, home, k, direction, float(end)))
    return tuple(walls)


def _wall(
    sampler: Sampler, design: Design, home: Mapping[str, float], k: int, direction: int, end: float
) -> Wall:
    names = list(home)
    start = home[names[k]]

    def at(value: float) -> np.ndarray[Any, np.dtype[np.float64]]:
        return np.array([[value if i == k else home[n]] for i, n in enumerate(names)])

    line = np.linspace(start, end, _STEPS)
    poses = np.repeat(at(start), _STEPS, axis=1)
    poses[k] = line
    margin, _ = sampler.evaluator.field(design, poses)
    dets = determinants(sampler.evaluator, design, poses)
    out = np.flatnonzero(margin < 0)
    flips = np.flatnonzero(np.sign(dets[1:]) != np.sign(dets[0])) + 1
    last = int(out[0]) if len(out) else _STEPS
    first = int(flips[0]) if len(flips) else _STEPS
    touch = _touch_along(sampler, design, poses, k, dets, min(first, last))

    def on_this_side(value: float) -> bool:
        here = float(determinants(sampler.evaluator, design, at(value))[0])
        return bool(here * np.sign(dets[0]) > 0)

    if touch is not None or first < last:
        value = touch
        if value is None:
            value = _bisect(on_this_side, float(line[first - 1]), float(line[first]))
        pose = {n: (value if n == names[k] else v) for n, v in home.items()}
        kind = _kind_at(sampler, design.parameters, pose)
        return Wall(names[k], direction, value, KINDS[kind],
                    _values(sampler, design, pose))  # fmt: skip
    if last == _STEPS:
        return Wall(names[k], direction, end, "end of the domain", {})
    value = _bisect(
        lambda v: float(sampler.evaluator.field(design, at(v))[0][0]) >= 0,
        float(line[last - 1]), float(line[last]),
    )  # fmt: skip
    pose = {n: (value if n == names[k] else v) for n, v in home.items()}
    return Wall(names[k], direction, value, _end_of_reach(sampler, design, pose),
                _values(sampler, design, pose))  # fmt: skip


def _touch_along(
    sampler: Sampler, design: Design, poses: np.ndarray[Any, np.dtype[np.float64]], k: int,
    dets: Vector, last: int,
) -> float | None:  # fmt: skip
    """Return where the determinant first touches 0 along a line, None where it does not."""
    size = np.abs(dets[:last])
    least = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] <= size[2:])) + 1
    if len(least) == 0:
        return None

    def size_at(values: Values) -> Values:
        return np.abs(determinants_along(sampler.evaluator, design, poses[:, least], k, values))

    ends = np.sort(np.stack([poses[k, least - 1], poses[k, least + 1]]), axis=0)
    places, sizes = least_along(size_at, ends[0], ends[1])
    met = np.flatnonzero(sizes <= _TOUCHES)
    return float(places[met[0]]) if len(met) else None


def _bisect(holds: Any, inside: float, outside: float) -> float:
    """Return where a condition ceases to hold, from the side where it does."""
    for _ in range(60):
        middle = (inside + outside) / 2
        if holds(middle):
            inside = middle
        else:
            outside = middle
    return inside


def _values(sampler: Sampler, design: Design, pose: Mapping[str, float]) -> dict[str, float]:
    """Return joints, parasitic and passive coordinates at a pose."""
    branch = branch_at(sampler.space.mechanism, sampler.space.working_mode, design.parameters, pose)
    if branch is None:
        return {}
    return {**branch.joints, **branch.parasitic, **branch.passive}


def _end_of_reach(sampler: Sampler, design: Design, pose: Mapping[str, float]) -> str:
    """Say what ends the reach at a pose on its boundary: a limit, or a limb's own reach."""
    mechanism = sampler.space.mechanism
    values = _values(sampler, design, pose)
    nearest: tuple[float, str] | None = None
    for c in mechanism.limited:
        for name, value in values.items():
            if c.name in design.limits and of_limb(c.name, name):
                low, high = design.limits[c.name]
                gap, end = min((abs(value - end), end) for end in (low, high))
                if math.isfinite(gap) and (nearest is None or gap < nearest[0]):
                    nearest = gap, f"limit of {name}, {end:.6g} {mechanism.unit(c)}"
    size = mechanism.characteristic_length(design.parameters)
    if nearest is not None and nearest[0] <= 1e-6 * max(size, 1.0):
        return nearest[1]
    measures = measures_at(
        sampler.space.mechanism, sampler.space.working_mode, design.parameters, pose
    )
    if measures:
        small = {key: abs(v) for key, v in measures.items() if key[0] == "inverse"}
        part = min(small, key=lambda key: small[key])
        if small[part] <= _ENDS:
            return f"{KINDS['inverse']}, {part[1]}"
    return (
        "a limit of clearance, cone or design"
        if sampler.space.settings.link_diameter
        or (sampler.space.settings.cone_angle or sampler.space.settings.tool)
        else "end of reach"
    )
