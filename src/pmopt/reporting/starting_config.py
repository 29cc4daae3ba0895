"""A commented configuration to start from."""

from __future__ import annotations

from pmopt.mechanisms import Mechanism
from pmopt.units import exact


def starting_config(mechanism: Mechanism) -> str:
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
