"""Commented configurations to start from, one for each kind and mechanism."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism
from pmopt.mechanisms.mechanism import Parameters
from pmopt.units import exact

#: Of a motion to start with: s, and the largest step from home, rad and as a share of the
#: characteristic length.
_DURATION, _ANGLE, _SHARE = 4.0, 0.1, 0.1
#: Poses of it that are tried, and how often the step is halved until all are regular.
_TRIED, _HALVINGS = 16, 10
#: Share of home's measures of singularity that they all keep.
_KEPT = 0.25


class Kind(NamedTuple):
    """A kind of configuration: what it is for, the command that reads it, what writes its text."""

    about: str
    command: str
    text: Callable[[Mechanism], str]


def _pareto(mechanism: Mechanism) -> str:
    """Return the text of a ``pmopt pareto`` configuration for a mechanism."""
    unit = mechanism.length_unit
    parameters = []
    for p in mechanism.parameters:
        note = f"{p.meaning}, {mechanism.unit(p)}"
        if p.bounds is None:
            parameters.append(f"# {p.name} = ...  # {note}")
        else:
            parameters.append(f"{p.name} = [{p.bounds[0]}, {p.bounds[1]}]  # {note}")
    units = {c.name: mechanism.unit(c) for c in mechanism.limited}
    limits = [
        f"# {name} = [{exact(low)}, {exact(high)}]  # {units[name]}; the default"
        for name, (low, high) in mechanism.default_limits(mechanism.resolve({})).items()
    ] or [f"# {mechanism.joints[0].name} = [-1.5, 1.5]  # {mechanism.unit(mechanism.joints[0])}"]
    coordinate = mechanism.pose[-1]
    return f"""\
# Pareto front of {mechanism.title}. Run it with: pmopt pareto THIS-FILE
# What is commented out shows a default or an example.

mechanism = "{mechanism.name}"
# Maximised: volume, gci (mean LCI), projected_volume (positions reached); minimised: footprint.
objectives = ["volume", "gci"]

[parameters]  # a range is a variable, a number is fixed, absent = the mechanism's own bounds
{chr(10).join(parameters)}

[workspace]
samples = "adaptive"  # of each design during the search; or a number, or target_error = 1e-2
{_sampler(mechanism)}
# working_mode = "{mechanism.working_modes[0]}"  # of {", ".join(mechanism.working_modes)}
# norm = "2"  # or "fro"
# jacobian = "{mechanism.default_jacobian}"  # or "{_other(mechanism)}"
# characteristic_length = 1.0  # {unit}, or "optimal"; default: {mechanism.length_meaning}
# aspect = "home"  # count only the singularity-free region around the home pose
# link_diameter = 0.01  # {unit}: links are capsules that must not meet
# cone_angle = 0.8  # rad: largest angle of passive U and S joints from their direction at home
# min_lci = 0.0  # poses with a smaller index do not count
# regions = [0.0, 0.1, 0.3, 1.0]  # edges of the dexterity regions

[workspace.domain]  # bounds on pose coordinates
# {coordinate.name} = [0.5, 1.5]  # {mechanism.unit(coordinate)}

[workspace.limits]  # bounds on joints, passive ones too
{chr(10).join(limits)}

[algorithm]
name = "nsga2"
population = 200
generations = 200
crossover_eta = 20
mutation_eta = 20
seed = 1
# reference = {{ volume = 0.0, gci = 0.0 }}  # what hypervolumes are measured from; the default

[constraints]
# gci = {{ min = 0.2 }}

[final]  # how finely the designs of the front are measured at the end
target_error = 5e-4  # relative standard error of volume and GCI
"""


def _sampler(mechanism: Mechanism) -> str:
    """Return the line of the sampler, the best one that the mechanism offers."""
    if mechanism.line is None:
        return '# sampler = "r-sequence"  # or "sobol", "monte-carlo"'
    along = mechanism.pose[mechanism.line_axis].name
    return f'sampler = "lines"  # exact along {along}; or "r-sequence", "sobol", "monte-carlo"'


def _other(mechanism: Mechanism) -> str:
    return "homogenized" if mechanism.default_jacobian == "raw" else "raw"


def _workspace(mechanism: Mechanism) -> str:
    """Return the text of a workspace for ``pmopt batch``."""
    return f"""\
# Workspace of {mechanism.title}. Run it with: pmopt batch THIS-FILE
# What is commented out shows a default or an example.

command = "workspace"
mechanism = "{mechanism.name}"
seed = 1
shape_grid = 0  # cells per axis that pieces and voids are counted on; 0: they are not

{_defaults(mechanism)}

[workspace]
samples = 1_000_000  # or grid = 100, cells per axis; or target_error = 1e-3, relative
{_sampler(mechanism)}
# working_mode = "{mechanism.working_modes[0]}"  # of {", ".join(mechanism.working_modes)}
# jacobian = "{mechanism.default_jacobian}"  # or "{_other(mechanism)}"
# min_lci = 0.0  # poses with a smaller index do not count

# [sweep]  # a run with each value; of several keys every combination
# seed = [1, 2, 3]
"""


def _batch(mechanism: Mechanism) -> str:
    """Return the text of a sweep of searches for ``pmopt batch``."""
    variables = [(p, p.bounds) for p in mechanism.parameters if p.bounds is not None]
    swept, bounds = variables[-1]
    ranges = "\n".join(
        f"# {p.name} = [{low}, {high}]  # {p.meaning}, {mechanism.unit(p)}"
        for p, (low, high) in variables
        if p is not swept
    )
    return f"""\
# Searches for the Pareto front of {mechanism.title}, one with each value of [sweep].
# Run it with: pmopt batch THIS-FILE; --dry-run says how many runs there are and how long they take.
# What is commented out shows a default or an example.

command = "pareto"  # or "workspace", "motion", with the keys of these
mechanism = "{mechanism.name}"
objectives = ["volume", "gci"]

[parameters]  # a range is a variable, a number is fixed, absent = the mechanism's own bounds
{ranges}

[workspace]
{_sampler(mechanism)}

[algorithm]
population = 40
generations = 30

[final]  # how finely the designs of the front are measured at the end
target_error = 5e-3  # relative standard error of volume and GCI

[sweep]  # every combination; the last key varies fastest
"parameters.{swept.name}" = [{bounds[0]}, {bounds[1]}]  # {swept.meaning}, {mechanism.unit(swept)}
# "algorithm.seed" = [1, 2]
"""


def _motion(mechanism: Mechanism) -> str:
    """Return the text of a motion about home for ``pmopt motion`` and ``pmopt simulate``."""
    if mechanism.posture is None:
        raise InputError(f"{mechanism.name} declares no posture: it cannot be moved")
    joint = mechanism.joints[0]
    rate = f"{mechanism.unit(joint)}/s"
    return f"""\
# A motion of {mechanism.title} to and fro through its home pose.
# Run it with: pmopt motion THIS-FILE, on an independent engine with: pmopt simulate THIS-FILE
# What is commented out shows a default or an example.

mechanism = "{mechanism.name}"
# working_mode = "{mechanism.working_modes[0]}"  # of {", ".join(mechanism.working_modes)}

{_defaults(mechanism)}

[trajectory]  # expressions of t in s; or waypoints, a gate, or the file of a recording
duration = {_DURATION}  # s
step = 0.01  # s
{chr(10).join(_expressions(mechanism))}

# [payload]
# mass = 1.0  # kg
# centre = [0.0, 0.0, 0.0]  # {mechanism.length_unit}, in the platform's frame

# [limits]  # of joints, and of their _rate, _acceleration, _effort and _power
# {joint.name}_rate = [-1.0, 1.0]  # {rate}

# [controller]  # for pmopt simulate
# feedforward = true
"""


def _defaults(mechanism: Mechanism) -> str:
    """Return the table of parameters, each at its default."""
    lines = ["[parameters]  # numbers; those left out take their defaults"]
    for p in mechanism.parameters:
        default = "..." if p.default is None else exact(p.default)
        lines.append(f"# {p.name} = {default}  # {p.meaning}, {mechanism.unit(p)}")
    return "\n".join(lines)


def _expressions(mechanism: Mechanism) -> list[str]:
    """Return an expression for each coordinate, with steps that keep the mechanism regular."""
    parameters = mechanism.resolve({})
    home = mechanism.home(parameters)
    length = mechanism.characteristic_length(parameters)
    steps = {c.name: _ANGLE if c.kind == "angle" else _SHARE * length for c in mechanism.pose}
    centre = {c.name: _rounded(home[c.name], 4) for c in mechanism.pose}
    for _ in range(_HALVINGS):
        found = {name: _rounded(step, 1) for name, step in steps.items()}
        if _is_regular(mechanism, parameters, centre, found):
            break
        steps = {name: step / 2 for name, step in steps.items()}
    turn = f"sin(2*pi*t/{_DURATION:g})"
    return [
        f'{c.name} = "{_from(centre[c.name])}{exact(found[c.name])}*{turn}"  # {mechanism.unit(c)}'
        for c in mechanism.pose
    ]


def _from(centre: float) -> str:
    return f"{exact(centre)} + " if centre else ""


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")


def _is_regular(
    mechanism: Mechanism, parameters: Parameters, centre: dict[str, float], step: dict[str, float]
) -> bool:
    """Return whether the default working mode holds, far from singularities, from end to end."""
    least: list[float] = []
    for k in (0, *range(-_TRIED, _TRIED + 1)):  # the centre first: the others are held against it
        pose = {name: value + step[name] * k / _TRIED for name, value in centre.items()}
        modes = {s.working_mode: s.joints for s in mechanism.inverse(parameters, pose)}
        joints = modes.get(mechanism.working_modes[0])
        if joints is None:
            return False
        measures = mechanism.singularity_measures(parameters, pose, joints).values()
        found = [value for parts in measures for value in parts.values()]
        least = least or [value * _KEPT for value in found]
        if any(value * bound < bound * bound for value, bound in zip(found, least, strict=True)):
            return False
    return True


KINDS = {
    "pareto": Kind("a search for the Pareto front", "pareto", _pareto),
    "motion": Kind("a trajectory, with joint motion and efforts", "motion", _motion),
    "batch": Kind("a sweep of searches", "batch", _batch),
    "workspace": Kind("a workspace as a run of a batch", "batch", _workspace),
}
