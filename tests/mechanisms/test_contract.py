"""What every mechanism of the catalogue must hold, whatever it is."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from support import five_bar, gough, naive, planar
from support.poses import box, constants_of, random_poses, reachable, ready

from pmopt.analysis.kinematics.inverse import inverse_kinematics
from pmopt.analysis.kinematics.jacobian import jacobian_at
from pmopt.analysis.kinematics.limits import of_limb
from pmopt.analysis.sampling.estimates import from_replicates, of_population
from pmopt.analysis.sampling.sampler import make_sampler
from pmopt.analysis.sampling.tallies import BINS
from pmopt.analysis.settings import WorkspaceSettings
from pmopt.compiler.records import flat, size
from pmopt.errors import InputError, PmoptError
from pmopt.kernels import sweep
from pmopt.mechanisms import find, names
from pmopt.mechanisms.mechanism import within
from pmopt.mechanisms.registry import collect
from pmopt.numerics.sequences import make_grid
from pmopt.synthesis.objectives import OF_SUMS

#: Those of the catalogue, two that are planar and one of six coordinates, by name.
OTHERS = (five_bar.MECHANISM, planar.MECHANISM, gough.MECHANISM)
EVERY = {m.name: m for m in (*map(find, names()), *OTHERS)}
# Of the eight modes of 3-CUR the default limits (links upwards) leave the first.
MODES = [
    (name, mode)
    for name, mechanism in EVERY.items()
    for k, mode in enumerate(mechanism.working_modes)
    if len(mechanism.working_modes) <= 4 or k == 0
]
#: Mechanisms whose kernels solve for coordinates by iteration: beyond the end of a solution the
#: last iterate depends on rounding, and the margin jumps where the iteration fails.
ITERATED = ("3-cur", "2uu-upu")
in_every_mode = pytest.mark.parametrize(("name", "mode"), MODES)


@pytest.fixture(params=EVERY)
def every_mechanism(request):
    """Return each mechanism in turn, those that are not of the catalogue too."""
    return EVERY[request.param]


def some_limits(mechanism, params, mode=None):
    """Return joint limits that cut into the workspace: the middle of what poses need."""
    pairs = reachable(mechanism, params, 60, mode)
    limits = {}
    for joint in mechanism.joints:
        values = [s.joints[joint.name] for _, s in pairs]
        if joint.kind == "angle":  # unwrapped about their mean direction
            mean = math.atan2(np.mean(np.sin(values)), np.mean(np.cos(values)))
            values = [mean + math.remainder(v - mean, 2 * math.pi) for v in values]
        limits[joint.name] = tuple(np.quantile(values, [0.08, 0.9]).tolist())
    return limits


# --- declarations -------------------------------------------------------------------------


def test_declarations(every_mechanism):
    mechanism = every_mechanism
    params = mechanism.parameters
    for group in (params, mechanism.pose, mechanism.joints, mechanism.limbs):
        labels = [member.name for member in group]
        assert labels
        assert len(set(labels)) == len(labels)
    assert not {c.name for c in mechanism.pose} & {p.name for p in params}
    assert len(set(mechanism.working_modes)) == len(mechanism.working_modes) > 0
    assert mechanism.default_jacobian in ("raw", "homogenized")
    assert mechanism.length_unit in ("m", "mm")
    for text in (mechanism.title, mechanism.description, mechanism.source, mechanism.freedom):
        assert text.strip()
    freedoms = re.findall(r"(\d)([TR])", mechanism.freedom)
    assert sum(int(count) for count, _ in freedoms) == len(mechanism.joints)
    for parameter in params:
        assert parameter.meaning.strip()
        assert parameter.source.strip()
        assert mechanism.unit(parameter) in (mechanism.length_unit, "rad", "1")
        if parameter.bounds is not None:
            low, high = parameter.bounds
            assert low < high
            assert parameter.accepts(low)
            assert parameter.accepts(high)
        if not parameter.optional:
            assert parameter.accepts(parameter.default)
    for coordinate in (*mechanism.pose, *mechanism.joints):
        assert coordinate.kind in ("length", "angle")
        assert coordinate.meaning.strip()
        wanted = "rad" if coordinate.kind == "angle" else mechanism.length_unit
        assert mechanism.unit(coordinate) == wanted
    ranges = mechanism.default_domain(mechanism.resolve({}))
    assert set(ranges) <= {c.name for c in mechanism.pose}
    assert all(low < high for low, high in ranges.values())


def test_one_name_for_each_joint(mechanism):
    """Joints are called alike in pictures, info, models and docs, and nothing else is."""
    params = mechanism.resolve({})
    coordinates = {c.name for c in (*mechanism.limited, *mechanism.parasitic)}
    others = {p.name for p in mechanism.parameters}
    assert not coordinates & others
    driven = {c.name for c in mechanism.joints}
    page = (Path(__file__).parents[2] / f"docs/mechanisms/{mechanism.name}.md").read_text()
    seen = []
    chains = mechanism.layout(params, mechanism.home(params), mechanism.working_modes[0])
    for number, (limb, chain) in enumerate(zip(mechanism.limbs, chains, strict=True)):
        assert len(limb.joint_names) == len(chain.joints)
        for k, joint in enumerate(chain.joints):
            name = mechanism.joint_name(number, k, joint.kind)
            # Where a joint has one freedom it is called as its coordinate, so that limits can be.
            single = joint.drive is not None and joint.kind in ("P", "R", "Pa")
            assert name == joint.drive[0] if single else name not in driven
            assert name in coordinates or re.fullmatch(rf"{joint.kind}_\w+", name)
            assert re.search(rf"\b{name}\b", limb.description)
            assert re.search(rf"\b{re.sub('[0-9]$', '', name)}", page)
            seen.append(name)
    assert len(set(seen)) == len(seen)
    assert not set(seen) & others
    assert set(mechanism.cones) <= set(seen)


def test_every_measure_says_where_it_vanishes(every_mechanism):
    mechanism = every_mechanism
    params = mechanism.resolve({})
    (pose, solution), *_ = reachable(mechanism, params, 1)
    measures = mechanism.singularity_measures(params, pose, solution.joints)
    assert {"inverse", "forward"} <= set(measures) <= {"inverse", "forward", "constraint"}
    for kind, parts in measures.items():
        assert parts
        for part, value in parts.items():
            assert mechanism.condition(kind, part).strip()
            assert abs(value) <= 1 + 1e-9


def test_defaults_are_feasible(mechanism):
    """The default design has a workspace within the default domain."""
    params = mechanism.resolve({})
    assert set(params) == {p.name for p in mechanism.parameters}
    design = make_sampler(mechanism, WorkspaceSettings()).design(params)
    assert design.box_volume > 0
    assert mechanism.characteristic_length(params) > 0
    assert reachable(mechanism, params, 1)


def test_parameters_are_checked(every_mechanism):
    mechanism = every_mechanism
    with pytest.raises(InputError, match=r"unknown name 'nonsense'.*nearest: "):
        mechanism.resolve({"nonsense": 1.0})
    for parameter in mechanism.parameters:
        value = 1.25 * parameter.default if parameter.default else 0.75
        resolved = mechanism.resolve({parameter.name: value})
        assert resolved == {**mechanism.resolve({}), parameter.name: value}
        negative = -4.0 if parameter.kind == "angle" else -1.0
        for wrong in (negative, math.nan, math.inf, "1.0 K", True, None):
            if wrong is None and parameter.optional:
                continue
            with pytest.raises(InputError, match=re.escape(f"{parameter.name}={wrong}")):
                mechanism.resolve({parameter.name: wrong})
        assert parameter.accepts(0.0) != parameter.positive


def test_poses_are_checked(every_mechanism):
    mechanism = every_mechanism
    (pose, solution), *_ = reachable(mechanism, mechanism.resolve({}), 1)
    for coordinates, good in ((mechanism.pose, pose), (mechanism.joints, solution.joints)):
        assert mechanism.check_coordinates(good, coordinates, "here") == good
        first = coordinates[0]
        for bad, text in [
            ({**good, "nonsense": 1}, "unknown name 'nonsense'"),
            ({k: v for k, v in good.items() if k != first.name}, f"{first.name} is missing"),
            ({**good, first.name: math.nan}, f"{first.name}=nan"),
            ({**good, first.name: "1 K"}, f"{first.name}=1 K"),
        ]:
            with pytest.raises(InputError, match=f"here: {text}"):
                mechanism.check_coordinates(bad, coordinates, "here")
        for coordinate in coordinates:
            degrees = {**good}
            degrees[coordinate.name + "_deg"] = math.degrees(degrees.pop(coordinate.name))
            if coordinate.kind == "angle":
                found = mechanism.check_coordinates(degrees, coordinates, "here")
                assert found == pytest.approx(good, rel=1e-14)
            else:
                with pytest.raises(InputError, match=f"{coordinate.name}_deg"):
                    mechanism.check_coordinates(degrees, coordinates, "here")


def test_found_by_name(mechanism):
    name = mechanism.name
    for written in (name, name.upper(), f" {name} ", name.replace("-", " "), name.replace("-", "")):
        assert find(written) is mechanism
    with pytest.raises(InputError, match=f"nearest: {name}$"):
        find(name[:-1])


@pytest.mark.parametrize("dash", ["\u2010", "\u2011", "\u2013"])
def test_found_by_name_as_papers_print_it(mechanism, dash):
    assert find(mechanism.name.replace("-", dash)) is mechanism


def test_unknown_and_double_names():
    with pytest.raises(InputError) as caught:
        find("no such thing")
    assert all(name in str(caught.value) for name in names())
    one = find(names()[0])
    assert list(collect([one]).values()) == [one]
    with pytest.raises(PmoptError, match="defined twice"):
        collect([one, one])


# --- kernel against the clear functions ---------------------------------------------------


@in_every_mode
@pytest.mark.parametrize("length", [1.0, 0.37, None])
def test_kernel_entries_are_the_inverse_jacobian(name, mode, length):
    """A multiple of J^-1; with a weight, of the homogenised one (columns of J divided by it)."""
    mechanism = EVERY[name]
    params = mechanism.resolve({})
    length = length or mechanism.characteristic_length(params)
    order = len(mechanism.joints)
    constants = ready(mechanism, params, mode, length)
    assert len(flat(constants)) == size(mechanism.constants)
    for pose, solution in reachable(mechanism, params, 60, mode):
        margin, *entries = mechanism.kernel(*pose.values(), constants)
        assert margin >= 0
        found = np.reshape(entries, (order, order))
        j_x, j_q = mechanism.velocity_maps(params, pose, solution.joints)
        rows, columns = mechanism.homogenizing(length)
        inverse = columns[:, None] * np.linalg.solve(j_q, j_x) / rows
        scale = np.linalg.norm(inverse) / np.linalg.norm(found)
        sign = np.sign((inverse * found).sum())
        np.testing.assert_allclose(
            sign * scale * found, inverse, rtol=0, atol=1e-9 * np.linalg.norm(inverse)
        )


@in_every_mode
def test_jacobian_at_agrees_with_the_kernel(name, mode):
    mechanism = EVERY[name]
    params = mechanism.resolve({})
    order = len(mechanism.joints)
    for kind, length in (("raw", 1.0), ("homogenized", None)):
        size = length or mechanism.characteristic_length(params)
        constants = ready(mechanism, params, mode, size)
        for pose, _ in reachable(mechanism, params, 10, mode):
            entries = mechanism.kernel(*pose.values(), constants)[1:]
            for norm in ("2", "fro"):
                expected = naive.inverse_condition(np.reshape(entries, (order, order)), norm)
                result = jacobian_at(mechanism, {}, pose, mode, kind=kind, norm=norm)
                assert result.lci == pytest.approx(expected, abs=1e-10)
                assert result.lci == (result.lci_raw if kind == "raw" else result.lci_homogenized)


@in_every_mode
def test_margin_is_the_limits_of_inverse(name, mode):
    """The kernel's margin is >= 0 exactly where there is a solution within every limit."""
    mechanism = EVERY[name]
    params = mechanism.resolve({})
    every = some_limits(mechanism, params, mode)
    near = [pose for pose, _ in reachable(mechanism, params, 60, mode, seed=7)]
    cases = [{}, every]
    for joint in mechanism.joints:
        low, high = every[joint.name]
        cases.append({joint.name: (low, high)})
        if joint.kind == "angle":  # counts modulo a turn
            cases.append({joint.name: (low + 2 * math.pi, high + 2 * math.pi)})
    poses = random_poses(mechanism, params, 140, margin=0.1) + near
    solved = [{s.working_mode: s for s in mechanism.inverse(params, pose)} for pose in poses]
    for number, limits in enumerate(cases):
        constants = ready(mechanism, params, mode, 1.0, limits)
        merged = {**mechanism.default_limits(params), **limits}
        seen = 0
        for count, (pose, solutions) in enumerate(zip(poses, solved, strict=True)):
            inside = mode in solutions and mechanism.admits(params, pose)
            if inside:
                values = {**solutions[mode].passive, **solutions[mode].joints}
                inside = all(
                    within(v, merged[c.name], c.kind)
                    for c in mechanism.limited
                    if c.name in merged
                    for k, v in values.items()
                    if of_limb(c.name, k)
                )
            assert (mechanism.kernel(*pose.values(), constants)[0] >= 0) == inside
            seen += inside
            if mode in solutions and (count + number) % 5 == 0:  # slow, and the same for all
                every = {c.name: merged[c.name] for c in mechanism.limited if c.name in merged}
                (told,) = inverse_kinematics(mechanism, params, pose, mode, every).within_limits
                assert told == inside
        assert 3 < seen < 197


def test_margin_is_continuous_outside(every_mechanism):
    """Between neighbouring poses the margin moves little, on both sides of zero."""
    mechanism = every_mechanism
    if mechanism.name in ITERATED:
        pytest.skip("the margin is continuous where there is a solution only")
    params = mechanism.resolve({})
    limits = some_limits(mechanism, params)
    constants = ready(mechanism, params, mechanism.working_modes[0], 1.0, limits)
    here, there = random_poses(mechanism, params, 2, margin=0.1)
    a, b = np.array(list(here.values())), np.array(list(there.values()))

    def steps(count):
        path = [a + (b - a) * t for t in np.linspace(0, 1, count)]
        return np.abs(np.diff([mechanism.kernel(*map(float, p), constants)[0] for p in path]))

    # A jump would stay as large on a path of sixteen times as many steps; a root (the margin of
    # a joint at the end of reach) shrinks by four.
    assert steps(3201).max() < 0.5 * steps(201).max()


def test_all_branches_assemble(every_mechanism):
    mechanism = every_mechanism
    params = mechanism.resolve({})
    size = mechanism.characteristic_length(params)
    for name, mode in MODES:
        if name != mechanism.name:
            continue
        for pose, solution in reachable(mechanism, params, 10, mode):
            poses = mechanism.forward(params, solution.joints)
            gaps = [max(abs(f.pose[k] - pose[k]) for k in pose) for f in poses]
            assert min(gaps) < 1e-7 * size
            assert max(f.residual for f in poses) < 1e-9 * size
        assert all(set(s.joints) == {j.name for j in mechanism.joints} for s in [solution])


# --- compiled sweep against a loop --------------------------------------------------------


def naive_sweep(sampler, design, points, count):
    """Return (margins, indices) of each replicate, pose by pose in plain Python."""
    mechanism = sampler.space.mechanism
    order = len(mechanism.joints)
    constants = constants_of(mechanism, design)
    results = []
    for replicate in range(points.replicates):
        poses = naive.fill(points, replicate, 0, count, design.lower, design.width)
        margins, indices = [], []
        for pose in poses.T.tolist():
            margin, *entries = mechanism.kernel(*pose, constants)
            margins.append(margin)
            if margin >= 0:
                matrix = np.reshape(entries, (order, order))
                indices.append(naive.inverse_condition(matrix, sampler.space.settings.norm))
        results.append((np.array(margins), np.array(indices)))
    return results


def half_domain(mechanism):
    """Return a domain that cuts the box on two sides."""
    params = mechanism.resolve({})
    lower, upper = box(mechanism, params)
    first, last = mechanism.pose[0].name, mechanism.pose[-1].name
    middle = (lower + upper) / 2
    return {
        first: (middle[0], math.inf),
        last: (-math.inf, middle[-1] + 0.3 * (upper - middle)[-1]),
    }


CASES = {
    "r-sequence": {},
    "sobol": {"sampler": "sobol"},
    "monte-carlo": {"sampler": "monte-carlo"},
    "grid": {"grid": 11},
    "min-lci": {"sampler": "sobol", "min_lci": 0.2},
    "fro": {"norm": "fro", "regions": (0, 0.05, 0.15, 0.2, 1)},
    "homogenized": {"jacobian": "homogenized"},
    "length": {"characteristic_length": 0.21, "sampler": "monte-carlo"},
    "one-region": {"regions": (0, 1), "min_lci": 0.1, "norm": "fro"},
    "limits": {"limits": some_limits, "sampler": "monte-carlo"},
    "domain": {"domain": half_domain, "sampler": "sobol"},
}


def settings_of(mechanism, case):
    options = dict(CASES[case])
    if "min_lci" in options:  # an index that some poses have
        home = mechanism.home(mechanism.resolve({}))
        options["min_lci"] = min(options["min_lci"], 0.3 * jacobian_at(mechanism, {}, home).lci)
    if "grid" in options:  # some thousand points whatever the dimension
        options["grid"] = {3: 11, 4: 8, 5: 6}[len(mechanism.pose)]
    if "limits" in options:
        options["limits"] = some_limits(mechanism, mechanism.resolve({}))
    if "domain" in options:
        options["domain"] = half_domain(mechanism)
    return WorkspaceSettings(**options)


#: 3-CUR has a large kernel of order 3, too: of 2UU-UPU the other norm takes long to compile.
LARGE = [("2uu-upu", case) for case in CASES if CASES[case].get("norm")]


@pytest.mark.parametrize(
    ("mechanism", "case"),
    [
        pytest.param(name, case, marks=pytest.mark.slow if (name, case) in LARGE else ())
        for name in names()
        for case in CASES
    ],
    indirect=["mechanism"],
)
def test_compiled_sweep_equals_a_loop(mechanism, case):
    """Counts, sums, extremes, regions and histogram of some blocks, the last one not full."""
    settings = settings_of(mechanism, case)
    sampler = make_sampler(mechanism, settings, seed=3, threads=1)
    design = sampler.design(mechanism.resolve({}))
    if settings.grid:
        points = make_grid(len(mechanism.pose), settings.grid)
        count = settings.grid ** len(mechanism.pose)
    else:
        points, count = sampler.sequence(3), 2 * sweep.BLOCK + 77
    tallies = sampler.evaluator.tally([design], points, 0, count, BINS)
    edges = settings.regions[1:-1]
    assert tallies.points == count
    assert tallies.box[0] == pytest.approx(np.prod(design.width), rel=1e-15)
    for r, (margins, indices) in enumerate(naive_sweep(sampler, design, points, count)):
        kept = indices[indices >= settings.min_lci]
        assert len(kept) > 20
        assert tallies.within[0, r] == len(indices) == (margins >= 0).sum()
        assert tallies.reachable[0, r] == len(kept)
        assert tallies.total[0, r] == pytest.approx(kept.sum(), abs=1e-8 * len(kept))
        assert tallies.smallest[0, r] == pytest.approx(kept.min(), abs=3e-8)
        assert tallies.largest[0, r] == pytest.approx(indices.max(), abs=3e-8)
        assert tallies.above[0, r].tolist() == [(kept >= edge).sum() for edge in edges]
        wanted = naive.histogram(kept)
        # An index within its error of a bin's edge may fall on the other side.
        assert np.abs(np.cumsum(tallies.histogram[0, r] - wanted)).max() <= 1
        assert (tallies.histogram[0, r] == wanted).mean() > 0.995


def test_chunks_add_up_to_the_whole(mechanism):
    """Any split at block boundaries gives the same counts; sums differ in the last digit."""
    for kind in ("r-sequence", "sobol", "monte-carlo"):
        sampler = make_sampler(mechanism, WorkspaceSettings(sampler=kind), threads=1)
        design = sampler.design(mechanism.resolve({}))
        points = sampler.sequence(4)
        whole = sampler.evaluator.tally([design], points, 0, 5000, BINS)
        parts = sampler.evaluator.tally([design], points, 0, 2 * sweep.BLOCK, BINS)
        parts.add(sampler.evaluator.tally([design], points, 2 * sweep.BLOCK, 5000, BINS))
        assert parts.points == whole.points == 5000
        for name in ("reachable", "within", "smallest", "largest", "above", "histogram"):
            assert (getattr(parts, name) == getattr(whole, name)).all(), name
        np.testing.assert_allclose(parts.total, whole.total, rtol=1e-13)


def test_margin_of_an_empty_sample_is_the_best_met(mechanism):
    """Out of reach everywhere: the largest margin tells how far from feasible a design is."""
    params = mechanism.resolve({})
    lower, upper = mechanism.reach_box(params, mechanism.default_limits(params))
    sampler = make_sampler(mechanism, WorkspaceSettings(), threads=1)
    design = sampler.design(params)
    k = [c.kind for c in mechanism.pose].index("length")  # a turn more would be the same angle
    design.lower[k] = upper[k] + 0.1 * (upper - lower)[k]
    points = sampler.sequence(2)
    tallies = sampler.evaluator.tally([design], points, 0, 700)
    for r, (margins, _) in enumerate(naive_sweep(sampler, design, points, 700)):
        assert margins.max() < 0
        assert tallies.margin[0, r] == pytest.approx(margins.max(), rel=1e-12)
        assert tallies.reachable[0, r] == 0


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_population_equals_designs_one_by_one(mechanism, threads):
    """A whole population on any number of threads, bit by bit; an empty design among them."""
    settings = WorkspaceSettings(sampler="sobol", regions=(0, 0.2, 1))
    sampler = make_sampler(mechanism, settings, threads=threads)
    scales = (1.0, 1.1, 0.9, 1.2, 0.8)
    sized = [p.name for p in mechanism.parameters if p.bounds and p.kind == "length"]
    designs = [
        sampler.design(mechanism.resolve({sized[0]: s * mechanism.resolve({})[sized[0]]}))
        for s in scales
    ]
    # An empty box at a reachable pose: a single point repeated, which must not count.
    empty = sampler.design(mechanism.resolve({}))
    empty.lower[:] = list(reachable(mechanism, mechanism.resolve({}), 1)[0][0].values())
    empty.width[:] = 0
    designs.insert(2, empty)
    points = sampler.sequence(4)
    whole = sampler.tally_population(designs, points, 3000)
    population = of_population(whole)
    assert population.volume[2] == 0
    assert not whole.reachable[2].any()
    assert math.isnan(population.gci[2])
    for i, design in enumerate(designs):
        single = sampler.evaluator.tally([design], points, 0, 3000, BINS)
        for name in ("box", "reachable", "total", "smallest", "largest", "margin", "above"):
            assert (getattr(whole, name)[i] == getattr(single, name)[0]).all(), name
        if i == 2:
            continue
        estimates = from_replicates(single)
        for at in OF_SUMS.values():
            value, error = getattr(estimates, at)
            assert getattr(population, at)[i] == pytest.approx(value, rel=1e-14)
            # Linearised against jackknife: equal in first order of the replicates' spread.
            assert getattr(population, f"{at}_error")[i] == pytest.approx(error, rel=0.05)
        assert population.volume_error[i] == pytest.approx(estimates.volume.error, rel=1e-10)


def test_field_equals_the_kernel(mechanism):
    """Inside, outside and far off: the index is finite, continued, and 0 where J is lost."""
    params = mechanism.resolve({})
    for norm in ("2", "fro"):
        sampler = make_sampler(mechanism, WorkspaceSettings(norm=norm), threads=2)
        design = sampler.design(params)
        poses = random_poses(mechanism, params, 500, margin=0.5)
        columns = np.array([list(p.values()) for p in poses]).T
        margin, lci = sampler.evaluator.field(design, columns)
        order = len(mechanism.joints)
        constants = constants_of(mechanism, design)
        for i, pose in enumerate(poses):
            expected, *entries = mechanism.kernel(*pose.values(), constants)
            assert (margin[i] >= 0) == (expected >= 0)
            if expected < 0 and mechanism.name in ITERATED:
                continue
            assert margin[i] == pytest.approx(expected, rel=1e-10, abs=1e-12)
            matrix = np.reshape(entries, (order, order))
            assert lci[i] == pytest.approx(naive.inverse_condition(matrix, norm), abs=3e-8)
