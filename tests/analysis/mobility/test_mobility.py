"""Mobility from declared joints: textbook mechanisms, then the catalogue."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.cli_runner import answer, csv_answer, error_line, here, json_answer

import pmopt
from pmopt.analysis.mobility import closed_form, finite_motion, screws
from pmopt.analysis.mobility import freedom as mobility
from pmopt.analysis.mobility.finite_motion import Assembly
from pmopt.analysis.mobility.freedom import Characteristic, analyse, mobility_of
from pmopt.errors import InputError
from pmopt.mechanisms import find, names
from pmopt.mechanisms.mechanism import Chain, Joint

X, Y, Z = np.eye(3)
O = np.zeros(3)


def unit(v):
    return np.asarray(v, dtype=float) / np.linalg.norm(v)


def across(first, link):
    return unit(np.cross(first, link))


def turned(degrees):
    """Return the radial and the tangential direction at an angle."""
    a = math.radians(degrees)
    return np.array([math.cos(a), math.sin(a), 0.0]), np.array([-math.sin(a), math.cos(a), 0.0])


def driven(name, limb):
    """Return a limb whose first prismatic joint, else first joint, is driven."""
    k = next((i for i, j in enumerate(limb) if j.kind == "P"), 0)
    limb = list(limb)
    limb[k] = dataclasses.replace(limb[k], drive=(name, 0))
    return Chain(name, tuple(limb))


# --- textbook mechanisms ----------------------------------------------------------------------


def four_bar():
    """A planar four-bar; the coupler is the platform: one rotation."""
    left = (Joint("R", O, (Z,)), Joint("R", np.array([0.2, 1.0, 0]), (Z,)))
    right = (Joint("R", 2 * X, (Z,)), Joint("R", np.array([2.6, 1.5, 0]), (Z,)))
    return [driven("a", left), Chain("b", right)], np.array([1.2, 1.2, 0])


def planar_3rpr():
    """2T1R, with three constraints common to all limbs."""
    limbs = []
    for k, degrees in enumerate((90, 210, 330)):
        foot, end = turned(degrees)[0], 0.4 * turned(degrees + 40)[0]
        limb = (Joint("R", foot, (Z,)), Joint("P", foot, (unit(end - foot),)),
                Joint("R", end, (Z,)))  # fmt: skip
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, O


def sarrus():
    """Two RRR limbs with axes along x and along y: a straight line."""
    limbs = []
    for k, (axis, out) in enumerate(((X, Y), (Y, X))):
        places = (out, 1.6 * out + 0.5 * Z, out + Z)
        limb = tuple(Joint("R", p, (axis,)) for p in places)
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, Z


def three_upu():
    """Tsai's 3-UPU: first and last axes tangential, three translations."""
    limbs = []
    for k, degrees in enumerate((0, 120, 240)):
        radial, tangent = turned(degrees)
        foot, end = 1.0 * radial, 0.5 * radial + 1.2 * Z
        w = across(tangent, end - foot)
        limb = (Joint("U", foot, (tangent, w)), Joint("P", foot, (unit(end - foot),)),
                Joint("U", end, (w, tangent)))  # fmt: skip
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, 1.2 * Z


def gough_stewart():
    """6-SPS: six freedoms and six local ones, the legs' turns about themselves."""
    limbs = []
    for k in range(6):
        foot = turned(60 * k + (10 if k % 2 else -10))[0]
        end = 0.6 * turned(60 * k + (-20 if k % 2 else 20))[0] + Z
        limb = (Joint("S", foot), Joint("P", foot, (unit(end - foot),)), Joint("S", end))
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, Z


def three_rps():
    """3-RPS, R axes tangential: 1T2R."""
    limbs = []
    for k, degrees in enumerate((0, 120, 240)):
        radial, tangent = turned(degrees)
        foot, end = radial, 0.6 * radial + Z
        limb = (Joint("R", foot, (tangent,)), Joint("P", foot, (unit(end - foot),)),
                Joint("S", end))  # fmt: skip
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, Z


def delta():
    """R-Pa-R-R limbs with parallel tangential axes: the Delta, 3T."""
    limbs = []
    for k, degrees in enumerate((0, 120, 240)):
        radial, tangent = turned(degrees)
        hip, knee = radial, 1.5 * radial - 0.3 * Z
        end = 0.3 * radial + 0.2 * tangent - 1.5 * Z
        bar = end - knee
        limb = (Joint("R", hip, (tangent,)), Joint("R", knee, (tangent,)),
                Joint("Pa", knee, (across(tangent, bar),), bar),
                Joint("R", end, (tangent,)))  # fmt: skip
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, -1.5 * Z


def uu_base():
    """Return base and platform joints of 2UU-UPU, centred: limb 1 at angle 0."""
    r, big, length = 0.35 / math.sqrt(3), 0.31 / math.sqrt(3), 0.25
    height = math.sqrt(length**2 - (r - big) ** 2)
    directions = [turned(d)[0] for d in (0, 120, 240)]
    return [(r * d, big * d + height * Z, d) for d in directions], height * Z


def uu_upu_radial():
    """The paper's 2UU-UPU: radial outer axes; three freedoms at this pose only."""
    limbs = []
    ends, centre = uu_base()
    for k, (foot, end, radial) in enumerate(ends):
        w = across(radial, end - foot)
        limb = [Joint("U", foot, (radial, w)), Joint("U", end, (w, radial))]
        if k == 0:
            limb.insert(1, Joint("P", foot, (unit(end - foot),)))
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, centre


def uu_ups():
    """2UU-UPS: outer axes of the UU limbs on the lines of their centres; three freedoms."""
    limbs = []
    ends, centre = uu_base()
    for k, (foot, end, _) in enumerate(ends):
        if k == 0:
            limb = [Joint("U", foot, (Y, across(Y, end - foot))),
                    Joint("P", foot, (unit(end - foot),)), Joint("S", end)]  # fmt: skip
        else:
            normal = across(Y, end - foot)
            limb = [Joint("U", foot, (Y, normal)), Joint("U", end, (normal, Y))]
        limbs.append(driven(f"limb {k + 1}", limb))
    return limbs, centre


def cur(radial_axes=False, literal=False):
    """3-CUR as the models page has it; ``literal``: without the U joint's second axis."""
    ra, rb, length = 0.2, 0.12, 0.25
    height = math.sqrt(length**2 - (ra - rb) ** 2)
    limbs = []
    for k, degrees in enumerate((0, 120, 240)):
        radial, tangent = turned(degrees)
        foot, end = ra * radial, rb * radial + height * Z
        second = across(tangent, end - foot)
        outer = radial if radial_axes else tangent
        middle = Joint("R", foot, (tangent,)) if literal else Joint("U", foot, (tangent, second))
        limb = [Joint("C", foot, (Z,)), middle, Joint("R", end, (outer,))]
        limb[0] = dataclasses.replace(limb[0], drive=(f"h{k + 1}", 1))
        limbs.append(Chain(f"limb {k + 1}", tuple(limb)))
    return limbs, height * Z


def ups(name, foot, end):
    """Return a limb that constrains nothing."""
    first = across(X, end - foot)
    second = across(first, end - foot)
    limb = (Joint("U", foot, (first, second)), Joint("P", foot, (unit(end - foot),)),
            Joint("S", end))  # fmt: skip
    return driven(name, limb)


def ups_sp():
    """3-UPS/SP with the paper's squares."""
    base = [np.array([x, y, 0]) for x, y in ((1, -1), (1, 1), (-1, 1), (-1, -1))]
    turn = screws.rotation(np.array([-0.1, 0.2, 0.0]))
    axis = turn @ Z
    centre = 17.5 * base[3] + turn @ (60 * Z - 10 * base[3])
    limbs = [ups(f"limb {k + 1}", 17.5 * base[k], centre + turn @ (10 * base[k])) for k in range(3)]
    sp = (Joint("S", 17.5 * base[3]), Joint("P", centre, (axis,)))
    return [*limbs, driven("limb 4", sp)], centre


def ups_rps():
    """4-UPS-RPS with the paper's circles, at X = 900."""
    angles, radii = np.radians([0, 45, 135, 225, 315]), [717, 645, 645, 645, 645]
    feet = [np.array([0, r * math.cos(a), r * math.sin(a)])
            for r, a in zip(radii, angles, strict=True)]  # fmt: skip
    turn = screws.rotation(math.pi / 2 * X)
    centre = 900 * X
    ends = [centre + 202 * turn @ np.array([0, math.sin(a), -math.cos(a)])
            for a in np.radians([0, 72, 144, 216, 288])]  # fmt: skip
    rps = (Joint("R", feet[0], (Z,)), Joint("P", feet[0], (unit(ends[0] - feet[0]),)),
           Joint("S", ends[0]))  # fmt: skip
    limbs = [ups(f"limb {k + 1}", feet[k], ends[k]) for k in range(1, 5)]
    return [driven("limb 1", rps), *limbs], centre


#: limbs, freedoms, kind, kept in finite motion, common and redundant constraints, Gruebler plain
TEXTBOOK = {
    "four-bar": (four_bar(), 1, "1R", 1, 3, 3, -2),
    "3-RPR": (planar_3rpr(), 3, "2T1R", 3, 3, 6, -3),
    "Sarrus": (sarrus(), 1, "1T", 1, 1, 1, 0),
    "3-UPU": (three_upu(), 3, "3T", 3, 0, 0, 3),
    "6-SPS": (gough_stewart(), 6, "3T3R", 6, 0, 0, 12),
    "3-RPS": (three_rps(), 3, "1T2R", 3, 0, 0, 3),
    "Delta": (delta(), 3, "3T", 3, 1, 3, 0),
    "2UU-UPU": (uu_upu_radial(), 3, "1T2R", 1, 1, 2, 1),
    "2UU-UPS": (uu_ups(), 3, "1T2R", 3, 0, 1, 2),
    "3-UPS/SP": (ups_sp(), 4, "3R1T", 4, 0, 0, 4),
    "4-UPS-RPS": (ups_rps(), 5, "3R2T", 5, 0, 0, 5),
    "3-CUR": (cur(), 3, "1T2R", 3, 0, 0, 3),
    "3-CRR": (cur(literal=True), 1, "1T", 1, 0, 1, 0),
}


@pytest.mark.parametrize("name", TEXTBOOK)
def test_textbook_mobility(name):
    """Freedoms, constraints and full cycle of mechanisms with known answers."""
    (limbs, centre), freedom, kind, kept, common, redundant, gruebler = TEXTBOOK[name]
    size = np.linalg.norm(np.subtract(limbs[0].joints[-1].point, centre)) or 1.0
    facts = analyse(limbs, centre, size, samples=6)
    assert (facts["freedom"], facts["poc"].kind) == (freedom, kind)
    assert facts["full_cycle"].freedom == kept
    assert len(facts["common_constraints"]) == common
    assert facts["redundant_constraints"] == redundant
    assert facts["gruebler"].mobility == gruebler
    assert facts["kutzbach_gruebler"].mobility == freedom + facts["local_freedoms"]
    assert facts["local_freedoms"] == (6 if name == "6-SPS" else 0)
    whole = facts["kutzbach_gruebler"]
    for order in (facts["declared_order"], facts["whole_limbs"]):
        assert sum(x.equations for x in order.loops) == whole.sum_f - whole.mobility
    least, dropped = facts["rank_gap"]
    assert dropped < 1e-12 < 1e-3 < least
    # Steps are really taken: the platform leaves its home where it is free.
    assert facts["full_cycle"].travel > 0.05


def test_lost_freedoms_are_seen_at_home():
    """The paper's 2UU-UPU: three freedoms at home that no finite step keeps."""
    (limbs, centre), *_ = TEXTBOOK["2UU-UPU"]
    facts = analyse(limbs, centre, 0.179, samples=6)
    cycle = facts["full_cycle"]
    assert [len(limb.wrenches) for limb in facts["limbs"]] == [1, 2, 2]
    assert cycle.kept_at_home < 3
    assert cycle.instantaneous == (1, 1)
    assert facts["kutzbach_gruebler"].to_dict() == {
        "d": 5, "n": 6, "g": 7, "sum_f": 13, "v": 0, "M": 3,
    }  # fmt: skip


def test_radial_axes_have_a_freedom_too_many():
    """3-CUR with radial revolute axes: four freedoms at home, of which motion keeps three."""
    facts = analyse(*cur(radial_axes=True), 0.12, samples=6)
    assert facts["freedom"] == 4
    assert facts["full_cycle"].freedom == 3


def test_coupling_degrees():
    """k of the single-open-chain method, by hand: SOC after SOC in the least coupled order."""
    expected = {"four-bar": 0, "3-RPR": 1, "3-UPU": 2, "3-RPS": 2, "Delta": 1, "6-SPS": 4}
    for name, k in expected.items():
        (limbs, centre), *_ = TEXTBOOK[name]
        facts = analyse(limbs, centre, 0.5, samples=1)
        assert facts["whole_limbs"].coupling == k, name
        assert sum(x.degree for x in facts["whole_limbs"].loops) == 0
    # Its slider known, limb 4 is a ball joint that the three others turn: 2 + 2 - 3, 2 - 3.
    facts = analyse(*ups_sp(), 14.1, samples=1)
    assert facts["whole_limbs"].coupling == 2
    assert facts["decomposition"].guide == "limb 4"
    assert [x.degree for x in facts["decomposition"].loops] == [1, -1]
    # Drives that do not number the freedoms have no k.
    assert analyse(*sarrus(), 0.5, samples=1)["whole_limbs"].coupling is None


@pytest.mark.parametrize(
    ("joints", "group"),
    [
        ((Joint("S", X),), True),
        ((Joint("P", O, (X,)), Joint("P", O, (Y,))), True),
        ((Joint("R", O, (Z,)), Joint("R", X, (Z,)), Joint("P", O, (X,))), True),
        ((Joint("P", O, (X,)), Joint("Pa", O, (Y,), unit(X + Z))), True),
        ((Joint("Pa", O, (Y,), X),), False),  # an arc: its direction turns
        ((Joint("U", O, (X, Y)),), False),
        ((Joint("R", O, (Z,)), Joint("R", X, (Z,))), False),
    ],
)
def test_motion_groups(joints, group):
    """Which limbs can guide a platform: spheres, planes, translations; no arcs."""
    limb = Chain("", joints)
    assert mobility._is_group(limb, screws.span(screws.limb_twists(limb))) == group


# --- spaces and motion ------------------------------------------------------------------------

numbers = st.integers(0, 2**32 - 1)


@given(numbers)
def test_reciprocal_and_intersection(seed):
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(6, rng.integers(0, 3)))
    a, b = (np.hstack([shared, rng.normal(size=(6, k))]) for k in rng.integers(1, 3, size=2))
    wrenches = screws.reciprocal(a)
    assert wrenches.shape[1] == 6 - screws.rank(a)
    work = a[:3].T @ wrenches[3:] + a[3:].T @ wrenches[:3]
    assert np.abs(work).max(initial=0.0) < 1e-12 * np.abs(a).max()
    assert screws.distance(screws.reciprocal(wrenches), a) < 1e-7
    common = screws.intersection(a, b)
    expected = screws.rank(a) + screws.rank(b) - screws.rank(np.hstack([a, b]))
    assert common.shape[1] == expected == max(shared.shape[1], expected)


def random_limb(rng):
    """Return a limb of every kind of joint."""
    a, b, c, d = (unit(v) for v in rng.normal(size=(4, 3)))
    points = rng.normal(size=(6, 3))
    return Chain(
        "all",
        (
            Joint("U", points[0], (a, across(a, b))), Joint("Pa", points[1], (b,), across(b, c)),
            Joint("C", points[2], (c,)), Joint("R", points[3], (d,)), Joint("S", points[4]),
            Joint("P", points[5], (unit(a + d),)),
        ),
    )  # fmt: skip


@given(numbers)
def test_moved_limbs_carry_their_joints(seed):
    """The twists are the derivative of the product of exponentials, anywhere on its way."""
    rng = np.random.default_rng(seed)
    limb = random_limb(rng)
    q = rng.uniform(-2, 2, screws.freedoms(limb))
    moved, end = screws.move(limb, q)
    columns = screws.limb_twists(moved)
    for k in range(q.size):
        # Joints move on from where they are: small steps of the moved limb are its twists.
        step = 1e-6 * np.eye(q.size)[k]
        twist = screws.small(screws.move(moved, step)[1]) / 1e-6
        np.testing.assert_allclose(twist, columns[:, k], atol=1e-5)
    # A rigid end: the last joint's point is where the displacement takes it.
    r, t = end
    before = limb.joints[-1]
    back = screws.move(Chain("", limb.joints[:-1]), q[:-1])[1]
    np.testing.assert_allclose(moved.joints[-1].point, back[0] @ before.point + back[1], atol=1e-9)
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-12)
    assert moved.joints[1].bar @ moved.joints[1].bar == pytest.approx(1.0)
    assert np.isfinite(t).all()


def test_parallelogram_translates_on_an_arc():
    limb = Chain("", (Joint("Pa", O, (Y,), 2 * X),))
    moved, (r, t) = screws.move(limb, np.array([math.pi / 2]))
    np.testing.assert_allclose(r, np.eye(3))
    np.testing.assert_allclose(t, [-2, 0, -2], atol=1e-15)
    np.testing.assert_allclose(moved.joints[0].bar, [0, 0, -2], atol=1e-15)


@given(st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3))
def test_small_inverts_rotation(vector):
    """The logarithm of a rotation, also near none and beyond a quarter turn."""
    twist = screws.small((screws.rotation(np.array(vector)), O))
    np.testing.assert_allclose(twist[:3], vector, atol=2e-8)


def test_walk_stays_assembled():
    limbs, centre = three_rps()
    home = Assembly.of([screws.scaled(c, centre, 0.6) for c in limbs])
    there = home.walked(np.random.default_rng(3), 5, 0.15)
    assert np.abs(there.misfit()).max() < finite_motion.CLOSED
    lengths = [np.linalg.norm(np.cross(j.point - k.point, k.axes[0]))
               for c in there.chains for j, k in itertools.pairwise(c.joints[:0:-1])]  # fmt: skip
    assert max(lengths) < 1e-11  # S still lies on the line of P


# --- readable screws --------------------------------------------------------------------------


def text_of(columns, is_twist=False, marks=()):
    space = screws.span(np.array(columns, dtype=float).T)
    return [s.text("m") for s in screws.readable(space, is_twist, O, 1.0, list(marks))]


def force(direction, point):
    return [*direction, *np.cross(point, direction)]


def test_screws_read_as_what_they_are():
    assert text_of([[0, 0, 0, 0, 0, 2]]) == ["couple about z"]
    assert text_of([[0, 0, 0, 0, 3, 0]], is_twist=True) == ["translation along y"]
    assert text_of([force(-X, Y)]) == ["force along x through (0, 1, 0) m"]
    assert text_of([force(X, Y)], marks=[Y + 2 * X]) == ["force along x through (2, 1, 0) m"]
    assert text_of([force(Z, X) + np.array([0, 0, 0, 0, 0, 0.25])]) == [
        "wrench along z through (1, 0, 0) m, pitch 0.25 m"
    ]
    # A pencil of forces in a point, then with a couple beside.
    assert text_of([force(unit(X + Y), O), force(unit(X - Y), O)]) == [
        "force along x through (0, 0, 0) m", "force along y through (0, 0, 0) m",
    ]  # fmt: skip
    assert text_of([force(X, Y), [0, 0, 0, 0, 0, 1]]) == [
        "force along x through (0, 0, 0) m", "couple about z",
    ]  # fmt: skip
    # Two skew lines span nothing else that is pure: they are found.
    skew = text_of([force(X, O) + np.array(force(Z, Y)), force(X, O) - 2 * np.array(force(Z, Y))])
    assert sorted(skew) == [
        "force along x through (0, 0, 0) m", "force along z through (0, 1, 0) m",
    ]  # fmt: skip


@given(numbers)
def test_readable_bases_span_the_space(seed):
    """Whatever the form: as many screws, spanning the same."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 7))
    space = screws.span(rng.integers(-2, 3, size=(6, count)).astype(float))
    found = screws.readable(space, True, O, 1.0, [])
    columns = []
    for s in found:
        direction = np.array(s.direction)
        if s.point is None:
            columns.append([*O, *direction])
        else:
            moment = np.cross(s.point, direction) + s.pitch * direction
            columns.append([*direction, *moment])
            assert (s.kind == "rotation") == (s.pitch == 0)
    if not found:
        assert space.shape[1] == 0
        return
    assert screws.distance(np.array(columns).T, space) < 1e-6


def test_kinds():
    names_of = {(3, 0): "3T", (1, 2): "1T2R", (1, 3): "3R1T", (2, 3): "3R2T", (3, 3): "3T3R",
                (3, 1): "3T1R", (0, 3): "3R", (0, 0): "0"}  # fmt: skip
    for (t, r), kind in names_of.items():
        assert Characteristic(t, r).kind == kind


# --- the catalogue ----------------------------------------------------------------------------

#: kind of every mechanism, its constraint counts by limb and redundant constraints
CATALOGUE = {
    "2pauu-ppap": ("3T", [1, 1, 3], 2),
    "3-cur": ("1T2R", [1, 1, 1], 0),
    "3-ups-sp": ("3R1T", [0, 0, 0, 2], 0),
    "4-ups-rps": ("3R2T", [1, 0, 0, 0, 0], 0),
    "2uu-upu": ("1T2R", [0, 2, 2], 1),
}
#: freedoms of other layouts at their pose and in the full cycle
LAYOUTS = {("3-cur", "literal"): (1, 1), ("2uu-upu", "paper"): (3, 1)}

in_catalogue = pytest.mark.parametrize("name", names())


@in_catalogue
def test_mechanism_mobility(name):
    """Home, then random configurations: what the declared joints give is what is declared."""
    mechanism = find(name)
    result = pmopt.mobility(name, samples=6)
    kind, wrenches, redundant = CATALOGUE.get(name, (mechanism.freedom, None, None))
    assert result.kind == kind == mechanism.freedom
    assert result.freedom == result.full_cycle.freedom == len(mechanism.joints)
    assert result.full_cycle.travel > 0.05
    assert result.kutzbach_gruebler.mobility == result.freedom + result.local_freedoms
    if wrenches is not None:
        assert sorted(len(x.wrenches) for x in result.limbs) == sorted(wrenches)
        assert result.redundant_constraints == redundant
    assert [x.joints for x in result.limbs] == [x.joints for x in mechanism.limbs]
    drives = [j.drive for c in mechanism.layout(result.params, result.pose) for j in c.joints]
    assert {d[0] for d in drives if d} == {c.name for c in mechanism.joints}
    assert result.coupling_degree is not None
    assert math.isfinite(result.rank_gap[0])
    assert result.rank_gap[1] < 1e-9 < 1e-4 < result.rank_gap[0]


@pytest.mark.parametrize("name", names())
def test_closed_form_against_the_joints(name):
    """Constraint residuals, layouts and Jacobian of the closed form, in every working mode."""
    mechanism = find(name)
    for mode in mechanism.working_modes[:2]:
        rng = np.random.default_rng(7)
        agreement = closed_form.compare(mechanism, mechanism.resolve({}), mode, 4, rng)
        assert agreement.poses == 4, mode
        assert agreement.holds, (mode, agreement)


@in_catalogue
def test_other_layouts(name):
    mechanism = find(name)
    for layout in mechanism.layouts:
        result = mobility_of(mechanism, layout=layout, samples=6)
        expected = LAYOUTS.get((name, layout))
        if expected:
            assert (result.freedom, result.full_cycle.freedom) == expected
    for known, layout in LAYOUTS:
        assert known != name or layout in mechanism.layouts


class Wrong(type(find("2pauu-ppap"))):
    """2PaUU-PPaP with one joint of its layout changed."""

    def __init__(self, limb, joint, **changes):
        self.place, self.changes = (limb, joint), changes

    def layout(self, *args):
        chains = list(super().layout(*args))
        limb, joint = self.place
        joints = list(chains[limb].joints)
        joints[joint] = dataclasses.replace(joints[joint], **self.changes)
        chains[limb] = Chain(chains[limb].name, tuple(joints))
        return tuple(chains)


@pytest.mark.parametrize(
    "wrong",
    [
        Wrong(0, 0, axes=(unit([0.1, 1, 0]),)),
        Wrong(0, 1, point=np.array([1.5, 0, 0.5])),
        Wrong(1, 2, axes=(unit([1, 0.1, 0]), Y)),
        Wrong(2, 2, axes=(Y,)),
        Wrong(0, 1, axes=(unit([0, 1, 0.02]), unit([0.8, 0, 0.6]))),
    ],
)
def test_wrong_layouts_are_noticed(wrong):
    rng = np.random.default_rng(7)
    assert not closed_form.compare(wrong, wrong.resolve({}), "out-out", 2, rng).holds


def test_wrong_closed_forms_are_noticed(pauu):
    """A platform off by a micrometre, and a Jacobian off by 0.01 per cent."""

    class Bent(type(pauu)):
        def platform(self, parameters, pose, working_mode=None):
            rotation, centre = super().platform(parameters, pose, working_mode)
            return rotation @ screws.rotation(1e-6 * pose["y"] * X), centre

    class Fast(type(pauu)):
        def velocity_maps(self, *args):
            j_x, j_q = super().velocity_maps(*args)
            return j_x * np.array([[1.0001], [1], [1]]), j_q

    for mechanism in (Bent(), Fast()):
        rng = np.random.default_rng(7)
        agreement = closed_form.compare(mechanism, mechanism.resolve({}), "out-out", 2, rng)
        assert not agreement.holds


@pytest.mark.parametrize("mode", ["out-out", "in-in", "out-in", "in-out"])
@pytest.mark.parametrize("params", [{}, {"m": 0.5, "n": 0.9}, {"l1": 1.4, "l2": 0.6}, {"h": 0.5}])
def test_2pauu_ppap_home_follows_the_dimensions(pauu, params, mode):
    """Regular in every mode, within h, and with three translations."""
    parameters = pauu.resolve(params)
    home = pauu.home(parameters)
    assert pauu.admits(parameters, home)
    centre = pauu.platform(parameters, home)[1]
    facts = analyse(pauu.layout(parameters, home, mode), centre, 0.65, samples=2)
    assert (facts["poc"].kind, facts["full_cycle"].freedom) == ("3T", 3)
    if mode in ("out-out", "in-in"):
        joints = next(s.joints for s in pauu.inverse(parameters, home) if s.working_mode == mode)
        measures = pauu.singularity_measures(parameters, home, joints)
        assert min(abs(v) for group in measures.values() for v in group.values()) > 1e-3


def test_2pauu_ppap_topology():
    """The paper's section 1.2: F = 13 - (6 + 4) = 3, characteristic t3 r0, coupling degree 0.

    The plain formula gives +2, -2 for these loops, +1, -1 for the least coupled order; 0 needs
    that limb 3, its slider known, is a plane the two other limbs' loop is closed in.
    """
    result = pmopt.mobility("2pauu-ppap", samples=1)
    assert [x.equations for x in result.declared_order.loops] == [6, 4]
    assert [x.degree for x in result.declared_order.loops] == [2, -2]
    assert [x.degree for x in result.whole_limbs.loops] == [1, -1]
    assert (result.poc.translations, result.poc.rotations) == (3, 0)
    assert result.coupling_degree == 0
    assert result.decomposition.guide == "limb 3"
    assert [x.degree for x in result.decomposition.loops] == [0]
    assert [len(x.twists) for x in result.limbs] == [5, 5, 3]


def test_2pauu_ppap_skeleton(pauu):
    """Platform, segments and cones against the declared joints, in every mode."""
    parameters = pauu.resolve({})
    rng = np.random.default_rng(2)
    for mode in pauu.working_modes:
        constants = pauu.kernel_constants(parameters, mode, 1.0, {})
        assert isinstance(constants, pauu.constants)
        home = pauu.skeleton(*pauu.home(parameters).values(), constants)
        np.testing.assert_allclose(home[-4:], 1.0, atol=1e-15)
        at_home = pauu.layout(parameters, pauu.home(parameters), mode)
        count = 0
        while count < 20:
            x, y, z = rng.uniform([-1, -1, 0.3], [1, 1, 2])
            pose = {"x": x, "y": y, "z": z}
            if not pauu.inverse(parameters, pose):
                continue
            count += 1
            flat = pauu.skeleton(x, y, z, constants)
            assert len(flat) == 12 + 6 * len(pauu.segments) + len(pauu.cones)
            rotation, centre = pauu.platform(parameters, pose, mode)
            np.testing.assert_allclose(flat[:12], [*centre, *rotation.ravel()])
            ends = np.reshape(flat[12:-4], (-1, 2, 3))
            chains = pauu.layout(parameters, pose, mode)
            for i in (0, 1):
                crank, inner, outer = (j.point for j in chains[i].joints)
                np.testing.assert_allclose(ends[2 * i], [crank, inner], atol=1e-12)
                np.testing.assert_allclose(ends[2 * i + 1], [inner, outer], atol=1e-12)
                np.testing.assert_allclose(ends[4 + i], [centre, outer], atol=1e-12)
                assert np.linalg.norm(outer - inner) == pytest.approx(1.5, abs=1e-12)
                before = at_home[i].joints[2].point - at_home[i].joints[1].point
                cosine = (outer - inner) @ before / 1.5**2
                np.testing.assert_allclose(flat[-4 + 2 * i : -2 + 2 * i or None], cosine)


# --- the command ------------------------------------------------------------------------------


def test_command(tmp_path):
    document = json_answer("mobility", "2PaUU PPaP", "--samples", 3, cwd=tmp_path)
    assert document["mechanism"] == "2pauu-ppap"
    assert (document["freedom"], document["kind"], document["coupling_degree"]) == (3, "3T", 0)
    assert document["kutzbach_gruebler"] == {"d": 6, "n": 8, "g": 9, "sum_f": 13, "v": 2, "M": 3}
    assert document["full_cycle"]["freedom"] == document["full_cycle"]["samples"] == 3
    assert [x["joints"] for x in document["limbs"]] == ["P_aUU", "P_aUU", "PP_aP"]
    assert [x["text"] for x in document["limbs"][2]["wrenches"]] == [
        "couple about x", "couple about y", "couple about z",
    ]  # fmt: skip
    assert document["closed_form"]["holds"]
    table = answer("mobility", "2pauu-ppap", "--samples", 3, cwd=tmp_path)
    assert "6 (8 - 9 - 1) + 13 + 2 = 3" in table
    assert answer("mobility", "2pauu-ppap", "--samples", 3, cwd=tmp_path) == table
    rows = csv_answer("mobility", "2pauu-ppap", "--samples", 3, cwd=tmp_path)
    counts = {r["quantity"]: r for r in rows if r["table"] == "count"}
    assert (counts["freedom"]["value"], counts["kind"]["text"]) == ("3", "3T")
    wrenches = [r for r in rows if r["body"] == "limb 3 (PP_aP), t3 r0" and r["kind"] == "couple"]
    assert [[float(r[f"direction_{x}"]) for x in "xyz"] for r in wrenches] == [
        [1, 0, 0], [0, 1, 0], [0, 0, 1],
    ]  # fmt: skip


def test_command_at_a_pose_and_other_dimensions(tmp_path):
    args = ("mobility", "2pauu-ppap", "--samples", 2, "--pose", "x=0.1,y=0.2,z=1.2")
    document = json_answer(*args, "--params", "l1=0.8", "--working-mode", "in-in", cwd=tmp_path)
    assert document["pose"] == {"x": 0.1, "y": 0.2, "z": 1.2}
    assert document["params"]["l1"] == 0.8
    assert document["kind"] == "3T"


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("--layout", "nonsense"), ("--layout", "'nonsense'", "declared")),
        (("--pose", "x=0,y=0,z=9"), ("--pose", "out of reach", "z=9.0")),
        (("--pose", "x=0,y=0"), ("--pose", "z is missing")),
        (("--params", "l9=1"), ("--params", "'l9'", "l1")),
        (("--working-mode", "up"), ("--working-mode", "'up'", "out-out")),
    ],
)
def test_bad_input(args, words, tmp_path):
    line = error_line(here("mobility", "2pauu-ppap", *args, cwd=tmp_path))
    assert all(word in line for word in words)


def test_bad_samples(pauu):
    with pytest.raises(InputError, match="samples=0"):
        mobility_of(pauu, samples=0)
