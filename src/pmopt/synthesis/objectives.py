"""The catalogue of objectives: what a search maximises, minimises or bounds.

An objective is one entry of :data:`OBJECTIVES`. Configurations, constraints, the columns of a front
with their units and errors, hypervolumes and pictures follow from it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from pmopt.analysis.sampling.estimates import PopulationEstimates
from pmopt.analysis.workspace.projection import Projection
from pmopt.mechanisms.mechanism import Mechanism
from pmopt.units import ONE, measure_unit


@dataclass(frozen=True)
class Objective:
    """A number that a design has, with its standard error.

    Attributes
    ----------
    unit : callable
        Returns its unit for a mechanism.
    source : type
        What it is read from: :class:`PopulationEstimates`, the sums of a sweep, of a whole
        population at once and of each design of a front again as :class:`Estimates`; or
        :class:`Projection`, what a design takes of space, which costs a sample of positions.
    attribute : str
        Where it stands there. Of a population ``attribute`` and ``attribute_error`` are columns.
    sense : {1, -1}
        +1 for what is maximised, -1 for what is minimised.
    """

    unit: Callable[[Mechanism], str]
    source: type[PopulationEstimates] | type[Projection]
    attribute: str
    sense: Literal[1, -1] = 1


def _cubic(mechanism: Mechanism) -> str:
    return measure_unit(["length"] * 3, mechanism.length_unit)


def _square(mechanism: Mechanism) -> str:
    return measure_unit(["length"] * 2, mechanism.length_unit)


#: By name, which a configuration, a front's column and a message use.
OBJECTIVES: dict[str, Objective] = {
    "volume": Objective(lambda mechanism: mechanism.volume_unit, PopulationEstimates, "volume"),
    "gci": Objective(lambda mechanism: ONE, PopulationEstimates, "gci"),
    "projected_volume": Objective(_cubic, Projection, "volume"),
    "footprint": Objective(_square, Projection, "footprint", -1),
}
#: Those that need what a design takes of space.
IN_SPACE = {name: o.attribute for name, o in OBJECTIVES.items() if o.source is Projection}
#: Those that come of the sums of a sweep.
OF_SUMS = {name: o.attribute for name, o in OBJECTIVES.items() if o.source is PopulationEstimates}
#: +1 for what is maximised, -1 for what is minimised.
SENSES: dict[str, int] = {name: objective.sense for name, objective in OBJECTIVES.items()}

if TYPE_CHECKING:
    ObjectiveName = str
else:
    ObjectiveName = Literal[*OBJECTIVES]


def objective_units(mechanism: Mechanism) -> dict[str, str]:
    """Return the unit of everything that can be an objective."""
    return {name: objective.unit(mechanism) for name, objective in OBJECTIVES.items()}
