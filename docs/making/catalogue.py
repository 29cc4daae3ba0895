"""Figures of the pages of 3-CUR, 3-UPS/SP, 4-UPS-RPS and 2UU-UPU."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping

import numpy as np

import pmopt
from making.figures import Figure, rounded, sampled
from making.pages import Finding, Says, Statement, table
from making.registry import maker
from making.words import mobility, numbers, parameters, percent, shape, trimmed, word
from pmopt.analysis.motion.records import Motion
from pmopt.analysis.singularities.families import Family
from pmopt.analysis.singularities.survey import SingularityResult
from pmopt.analysis.workspace.compute import WorkspaceResult
from pmopt.errors import PmoptError
from pmopt.mechanisms import find
from pmopt.mechanisms.mechanism import InverseSolution

CUR, SP, RPS, UPU = (
    f"docs/mechanisms/{name}.md" for name in ("3-cur", "3-ups-sp", "4-ups-rps", "2uu-upu")
)
MOTIONS = "configs/motion"


@functools.cache
def workspace(name: str) -> WorkspaceResult:
    """Return the workspace of a mechanism as ``pmopt workspace`` has it."""
    return pmopt.workspace(name)


@functools.cache
def singular(name: str, *params: tuple[str, float]) -> SingularityResult:
    """Return what ``pmopt singularities`` finds."""
    return pmopt.singularities(name, dict(params))


def inverse(name: str, pose: Mapping[str, float]) -> InverseSolution:
    """Return the default working mode's solution."""
    mechanism = find(name)
    mode = mechanism.working_modes[0]
    return pmopt.ik(name, pose, working_mode=mode).solutions[0]


def home_share(found: SingularityResult) -> Figure:
    """Return the share of the home aspect in per cent, with its error."""
    share = next(a.share for a in found.aspects if a.home)
    return sampled(100 * share.value, 100 * share.error)


def home_lci(found: SingularityResult) -> str:
    """Return the index at home."""
    return f"{found.home_lci:.4f}"


# --- 3-CUR --------------------------------------------------------------------------------


@maker("3-cur")
def cur() -> Iterator[Statement | Finding]:
    """Yield sizes, a pose, volumes, shape and singularities of 3-CUR."""
    name = "3-cur"
    mechanism = find(name)
    yield parameters(CUR, mechanism)
    pose = {"z": 0.35, "beta": 0.25, "gamma": 0.15}
    found = inverse(name, pose)
    yield table(
        CUR, "pose", ("z (m), beta, gamma (rad)", "x, y (m), alpha (rad)", "h1, h2, h3 (m)"),
        [(numbers(pose, 2), numbers(found.parasitic, 7), numbers(found.joints, 7))],
    )  # fmt: skip
    result = workspace(name)
    yield Says(CUR, "without knowing it: {} with 4 million samples",
               (sampled(*result.volume, result.volume_unit),))  # fmt: skip
    volume, error = mechanism.decoupled_volume(mechanism.resolve({}))
    yield Says(CUR, "integrates that: {} on a grid of 1 degree",
               (sampled(volume, error, result.volume_unit),))  # fmt: skip
    yield Says(
        CUR,
        "no holes | true: {}, of the poses and of the positions reached (`pmopt",
        (shape(result.shape.workspace),),
    )
    if shape(result.projection.shape) != shape(result.shape.workspace):
        yield Finding(CUR, 1, "positions as poses", shape(result.projection.shape))
    yield Says(CUR, "`pmopt mobility 3-cur` gives {} |", (mobility(pmopt.mobility(name)),))
    literal = pmopt.mobility(name, layout="literal")
    yield Says(CUR, "`pmopt mobility 3-cur --layout literal` gives {}, full cycle {}.",
               (literal.kind, str(literal.full_cycle.freedom)))  # fmt: skip
    home = mechanism.home(mechanism.resolve({}))
    tilted = inverse(name, {**home, "gamma": 0.5})
    reach = max(abs(v) for k, v in tilted.passive.items() if k.startswith("theta4"))
    yield Says(CUR, "theta4, which reaches {} deg at gamma = 0.5",
               (rounded(math.degrees(reach), ".0f"),))  # fmt: skip
    walls = singular(name)
    if any(n.crossed for n in walls.nearness):
        yield Finding(CUR, 1, "no change of sign", "a determinant that changes its sign")
    yield Says(CUR, "within the default limits: {} aspect, LCI at least {} |",
               (word(len(walls.aspects)), rounded(result.smallest.value, ".2f")))  # fmt: skip


@maker("3-cur-finely", slow=True)
def cur_finely() -> Iterator[Statement]:
    """Yield the volume of 3-CUR on a fine grid of tilts."""
    mechanism = find("3-cur")
    volume = mechanism._integrated(mechanism.resolve({}), None, 0.25)
    yield Says(CUR, "on a grid of 1 degree, {} on one of 0.25 degrees", (rounded(volume, ".5f"),))


# --- 3-UPS/SP -----------------------------------------------------------------------------


@maker("3-ups-sp")
def ups_sp() -> Iterator[Statement]:
    """Yield sizes, poses, volumes and shape of 3-UPS/SP."""
    name = "3-ups-sp"
    mechanism = find(name)
    yield parameters(SP, mechanism)
    rows = []
    for pose in (
        {"phi": 0, "theta": 0, "psi": 0, "l4": 45},
        {"phi": 0.1, "theta": 0.2, "psi": -0.15, "l4": 60},
    ):
        centre = mechanism.platform(mechanism.resolve({}), pose)[1]
        places = ", ".join(trimmed(v, 7) for v in centre)
        joints = inverse(name, pose).joints
        lengths = ", ".join(trimmed(v, 7) for v in joints.values())
        rows.append((", ".join(trimmed(v, 2) for v in pose.values()), places, lengths))
    head = ("phi, theta, psi (rad), l4 (mm)", "P (mm)", "l1 .. l4 (mm)")
    yield table(SP, "poses", head, rows)
    yield Says(SP, "at most eight assembly modes; {} are real at the second pose",
               (word(len(pmopt.fk(name, joints).solutions)),))  # fmt: skip
    result = workspace(name)
    yield Says(SP, "The workspace has {}; what",
               (sampled(*result.volume, result.volume_unit),))  # fmt: skip
    yield Says(SP, "`projected volume`, {}.",
               (sampled(*result.projection.volume, "mm^3"),))  # fmt: skip
    yield Says(SP, "without voids | true: {}, of the four-dimensional pose set",
               (shape(result.shape.workspace),))  # fmt: skip
    yield Says(SP, "`pmopt mobility 3-ups-sp` gives {} |", (mobility(pmopt.mobility(name)),))


@maker("3-ups-sp-variants")
def ups_sp_variants() -> Iterator[Statement]:
    """Yield what kite and twist do about the singular poses of 3-UPS/SP."""
    name = "3-ups-sp"
    mechanism = find(name)
    designs = {
        "kite 1, twist 0 (paper)": {},
        "twist 0.6": {"twist": 0.6},
        "kite 0.6": {"kite": 0.6},
        "kite 0.6, twist 0.6": {"kite": 0.6, "twist": 0.6},
    }
    families, values, indices, shares = [], [], [], []
    for design in designs.values():
        found = singular(name, *design.items())
        slices = [f for f in found.families if f.in_domain]
        families.append("; ".join(map(_slice, slices)))
        pose = {"phi": 0.3, "theta": 0.0, "psi": 0.0, "l4": 60.0}
        j_x, _ = mechanism.velocity_maps(mechanism.resolve(design), pose, {})
        values.append(trimmed(float(np.linalg.svd(j_x, compute_uv=False)[-1]), 2))
        indices.append(home_lci(found))
        share = next(a.share for a in found.aspects if a.home)
        shares.append(rounded(share.value, ".3f", share.error))
    yield table(
        SP, "variants", ("", *designs),
        (
            ("singular families in the domain", *families),
            ("smallest singular value of J_X at theta = psi = 0, phi = 0.3, l4 = 60 (mm/rad)",
             *values),
            ("LCI at home", *indices),
            ("share of the home aspect", *shares),
        ),
    )  # fmt: skip
    yield Says(
        SP,
        "nothing of singularities: {} aspects divide it in halves",
        (word(len(singular(name).aspects)),),
    )


def _slice(family: Family) -> str:
    """Return a singular family in words, equal values together."""
    by_value: dict[str, list[str]] = {}
    for name, value in family.fixed.items():
        by_value.setdefault(f"{value + 0.0:.4g}", []).append(name)
    fixed = ", ".join(f"{' = '.join(group)} = {value}" for value, group in by_value.items())
    return f"{fixed}, any {', '.join(family.free)}"


# --- 4-UPS-RPS ----------------------------------------------------------------------------


@maker("4-ups-rps")
def ups_rps() -> Iterator[Statement]:
    """Yield sizes, poses, volumes, shape and the efforts of a motion of 4-UPS-RPS."""
    name = "4-ups-rps"
    mechanism = find(name)
    yield parameters(RPS, mechanism)
    quarter, small = math.pi / 2, -math.pi / 36
    poses = {
        "900, 0, 0, 0, pi/2": (900, 0, 0, 0, quarter),
        "950, 0, -pi/36, -pi/36, 0": (950, 0, small, small, 0),
        "950, 0, -pi/36, -pi/36, pi/2": (950, 0, small, small, quarter),
        "900, 30, 0.05, -0.08, pi/2 + 0.1": (900, 30, 0.05, -0.08, quarter + 0.1),
    }
    rows = []
    for text, values in poses.items():
        pose = dict(zip((c.name for c in mechanism.pose), values, strict=True))
        found = inverse(name, pose)
        rows.append((text, trimmed(found.parasitic["z"], 6), numbers(found.joints, 6)))
    head = ("x, y (mm), alpha, beta, gamma (rad)", "z (mm)", "l1 .. l5 (mm)")
    yield table(RPS, "poses", head, rows)
    yield Says(RPS, "allows \\|z\\| <= r = 202: z = {} at t = 0",
               (rounded(float(rows[1][1]), ".2f"),))  # fmt: skip
    result = workspace(name)
    yield Says(RPS, "The workspace has {}, {}; the positions reached fill {}.",
               (sampled(*result.volume, result.volume_unit), shape(result.shape.workspace),
                sampled(*result.projection.volume, "mm^3")))  # fmt: skip
    yield Says(RPS, "`pmopt mobility 4-ups-rps` gives {} |", (mobility(pmopt.mobility(name)),))
    motion = pmopt.motion(f"{MOTIONS}/4-ups-rps-home.toml").motion
    yield Says(RPS, "gamma = pi/2, asks at most {} N of a limb",
               (f"{np.abs(motion.effort).max():.1f}",))  # fmt: skip


@maker("4-ups-rps-walls")
def ups_rps_walls() -> Iterator[Statement]:
    """Yield the singular poses of 4-UPS-RPS, along the paper's motion too."""
    name = "4-ups-rps"
    mechanism = find(name)
    found = singular(name)
    level = {"alpha": 0.0, "beta": 0.0, "gamma": 0.0}
    family = next((f for f in found.families if f.fixed == level), None)
    where = "none" if family is None else "inside" if family.in_domain else "beyond"
    yield Says(RPS, "`pmopt singularities 4-ups-rps` finds, {} the default domain", (where,))
    wall = next(w for w in found.walls if (w.coordinate, w.direction) == ("alpha", 1))
    yield Says(RPS, "the nearest forward singularity along a coordinate is at alpha = {} rad",
               (rounded(wall.value, ".4f"),))  # fmt: skip
    yield Says(RPS, "The home aspect holds ({}) % of the workspace", (home_share(found),))
    params = mechanism.resolve({})

    def determinants(gamma: float) -> list[float]:
        values = []
        for t in np.linspace(0, 2, 201):
            tilt = math.pi / 36 * (t - 1)
            place = (900 + 50 * math.cos(2 * t), 50 * math.sin(2 * t), tilt, tilt, gamma)
            pose = dict(zip((c.name for c in mechanism.pose), place, strict=True))
            found = mechanism.singularity_measures(params, pose, inverse(name, pose).joints)
            values.append(found["forward"]["platform"])
        return values

    through = determinants(0.0)
    instant = int(np.argmin(np.abs(through)))
    yield Says(RPS, "forward (type II) at t = {} s, row {} ",
               (f"{instant / 100:g}", str(instant + 1)))  # fmt: skip
    turned = determinants(math.pi / 2)
    signs = np.unique(np.sign(turned))
    least = math.floor(1000 * np.abs(turned).min()) / 1000 if len(signs) == 1 else 0.0
    yield Says(RPS, "forward one stays above {} in size", (f"{least:.3f}",))


# --- 2UU-UPU ------------------------------------------------------------------------------


@maker("2uu-upu")
def uu_upu() -> Iterator[Statement]:
    """Yield sizes, a state, volume, mobility and singularities of 2UU-UPU."""
    name = "2uu-upu"
    mechanism = find(name)
    params = mechanism.resolve({})
    yield parameters(UPU, mechanism)
    a, c, link = params["bs"] / 2, params["ps"] / 2, params["L"]
    limit = math.degrees(math.acos((a**2 + c**2 - link**2) / (2 * a * c)))
    yield Says(UPU, "exists for |kappa| <= {} deg (default sizes)", (rounded(limit, ".2f"),))
    lengths = mechanism.default_limits(params)["l1"]
    yield Says(UPU, "is passive: {} m at the default L",
               (" .. ".join(f"{v:g}" for v in lengths),))  # fmt: skip
    result = workspace(name)
    yield Says(UPU, "The workspace in mode `up` has {}, {}.",
               (sampled(*result.volume, result.volume_unit), _without(result)))  # fmt: skip
    first, paper = pmopt.mobility(name), pmopt.mobility(name, layout="paper")
    yield Says(
        UPU,
        "`pmopt mobility 2uu-upu --layout paper` finds {} freedoms at home and {} after finite "
        "motion. `pmopt mobility 2uu-upu` finds {} and {}.",
        tuple(word(n) for m in (paper, first) for n in (m.freedom, m.full_cycle.freedom)),
    )
    formula = str(paper.kutzbach_gruebler).replace(" ", "").replace("=", " = ")
    yield Says(UPU, "2UU-UPU has three freedoms, {} | at an isolated", (formula,))
    found = singular(name)
    always = {k: v for n in found.nearness for k, v in n.always.items()}
    yield Says(UPU, "in line with the coupler wherever kappa = {} deg",
               (rounded(math.degrees(always["kappa"]), ".4f"),))  # fmt: skip
    share = next(s.share for s in found.aspects if s.home)
    yield Says(UPU, "The home aspect holds {} % of the workspace |",
               (percent(share.value, share.error),))  # fmt: skip


def _without(result: WorkspaceResult) -> str:
    return shape(result.shape.workspace).replace(", no void", " without a void")


@maker("2uu-upu-state")
def uu_upu_state() -> Iterator[Statement | Finding]:
    """Yield a state of 2UU-UPU from its internal coordinates, all ways around."""
    name = "2uu-upu"
    mechanism = find(name)
    params = mechanism.resolve({})
    seeds = {"phi": 0.5, "kappa": 0.05, "psi": -0.4}
    pose = _pose_of(params, **seeds)
    found = inverse(name, pose)
    known = {**found.joints, **found.passive}
    if any(abs(known[k] - v) > 1e-9 for k, v in seeds.items()):
        yield Finding(UPU, 1, f"a state {seeds}", f"another one, {known}")
    yield table(
        UPU, "state",
        ("phi, kappa, psi (rad)", "x (m), beta, gamma (rad)", "y, z (m)",
         "theta1, delta2, delta3 (rad)", "l1 (m)"),
        [(
            ", ".join(f"{v:g}" for v in seeds.values()),
            numbers(pose, 7),
            numbers({k: found.parasitic[k] for k in "yz"}, 7),
            numbers({k: known[k] for k in ("theta1", "delta2", "delta3")}, 7),
            numbers({"l1": known["l1"]}, 7),
        )],
    )  # fmt: skip


def _pose_of(
    params: Mapping[str, float | None], phi: float, kappa: float, psi: float
) -> dict[str, float]:
    """Return x, beta, gamma of internal coordinates by the equations of the page."""
    a, c, link = params["bs"] / 2, params["ps"] / 2, params["L"]
    rho2 = a**2 + c**2 - 2 * a * c * math.cos(kappa)
    rise = math.sqrt(link**2 - rho2) / math.sqrt(rho2) * (a - c * math.cos(kappa))

    def turn(angle: float, axis: int) -> np.ndarray:
        s, k = math.sin(angle), math.cos(angle)
        i, j = [m for m in range(3) if m != axis]
        sign = -1 if axis == 1 else 1
        matrix = np.eye(3)
        matrix[i, i] = matrix[j, j] = k
        matrix[i, j], matrix[j, i] = -sign * s, sign * s
        return matrix

    rot = turn(phi, 1) @ turn(kappa, 0) @ turn(psi, 1)
    radius = {"base": params["bs"] / math.sqrt(3), "platform": params["ps"] / math.sqrt(3)}
    middle = np.array([-radius["base"] / 2, 0.0, 0.0])
    side = math.sqrt(link**2 - rho2) / math.sqrt(rho2) * c * math.sin(kappa)
    place = middle + turn(phi, 1) @ [0.0, side, rise] + radius["platform"] / 2 * rot[:, 0]
    beta = math.asin(-rot[2, 0])
    return {"x": float(place[0]), "beta": beta, "gamma": math.atan2(rot[2, 1], rot[2, 2])}


@maker("2uu-upu-motion")
def uu_upu_motion() -> Iterator[Statement]:
    """Yield what the paper says of its motion, against the motion itself."""
    run = pmopt.motion(f"{MOTIONS}/2uu-upu-t1.toml")
    motion = run.motion
    names = [c.name for c in find("2uu-upu").passive]
    lengths = motion.passive.values[:, names.index("l1")]
    yield Says(UPU, "with l1 between {} and {} m",
               (rounded(lengths.min(), ".4f"), rounded(lengths.max(), ".4f")))  # fmt: skip
    omega = motion.angular[:, 0]
    beta, gamma = motion.pose.rates[:, 1], motion.pose.rates[:, 2]
    alpha = motion.parasitic.rates[:, 2]
    # (gamma', beta', alpha'), which the paper calls the angular velocity
    gap = np.linalg.norm(omega - np.stack([gamma, beta, alpha], axis=1), axis=1).max()
    largest = np.linalg.norm(omega, axis=1).max()
    yield Says(UPU, "on the feasible trajectory {} mrad/s off, {} % of the largest",
               (rounded(1e3 * gap, ".2f"), rounded(100 * gap / largest, ".1f")))  # fmt: skip
    excess, height = _link_angles(motion)
    yield Says(UPU, "on the same trajectory they exceed it by up to {} %",
               (rounded(100 * excess, ".1f"),))  # fmt: skip
    yield Says(UPU, "z_c is l/2 sqrt(1 - cos^2 theta_i - cos^2 theta_ii), up to {} mm away",
               (rounded(1e3 * height, ".1f"),))  # fmt: skip
    printed = pmopt.motion(f"{MOTIONS}/2uu-upu-eq16.toml")
    count = (str(printed.infeasible_instants), str(len(printed.motion.t)))
    yield Says(UPU, "(16) | {} of {} instants are infeasible", count)
    yield Says("docs/motion.md", "the printed one: {} of {} instants are out of reach", count)


def _link_angles(motion: Motion) -> tuple[float, float]:
    """Return by how much (10) and (11) fail for the UU links, whose directions are known."""
    phi = motion.joints.values[:, 1]
    excess, height = [], []
    for swing in (motion.passive.values[:, 2], motion.joints.values[:, 2]):
        u = np.stack([np.sin(phi) * np.cos(swing), np.sin(swing), np.cos(phi) * np.cos(swing)])
        cos_i, cos_ii = u[0], u[1]
        sines = np.sqrt((1 - cos_i**2) * (1 - cos_ii**2))
        # (10): cos^2 theta_i + cos^2 theta_ii + sin^2 theta_i sin^2 theta_ii = 1
        excess.append((cos_i**2 + cos_ii**2 + sines**2 - 1).max())
        # (11) differentiates z_c = l/2 sin theta_i sin theta_ii
        height.append(np.abs(motion.params["L"] / 2 * (sines - u[2])).max())
    return max(excess), max(height)


@maker("2uu-upu-configurations", slow=True)
def uu_upu_configurations() -> Iterator[Statement]:
    """Yield in how many configurations poses of 2UU-UPU are reached."""
    name = "2uu-upu"
    box = pmopt.workspace(name, samples=1 << 14, shape_grid=0).box
    rng = np.random.default_rng(1)
    counts: list[int] = []
    while len(counts) < 2000:
        pose = {key: float(rng.uniform(*ends)) for key, ends in box.items()}
        try:
            found = pmopt.ik(name, pose)
        except PmoptError:
            continue
        modes = zip(found.solutions, found.within_limits, strict=True)
        if any(inside and s.working_mode in ("up", "down") for s, inside in modes):
            counts.append(len(found.solutions))
    shares = [np.mean(np.isin(counts, group)) for group in ((4,), (2,), (6, 8))]
    errors = [math.sqrt(p * (1 - p) / len(counts)) for p in shares]
    yield Says(
        UPU,
        "reaches, {} % are reached in four configurations, {} % in two, {} % in six or eight",
        tuple(percent(float(p), e) for p, e in zip(shares, errors, strict=True)),
    )
