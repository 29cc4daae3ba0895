"""Results at a pose and of the joints."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from pmopt.analysis.kinematics import forward, inverse, jacobian
from pmopt.analysis.mobility import freedom
from pmopt.api.keywords import named
from pmopt.api.results.showing import Showing, axes_of, place_text
from pmopt.errors import InputError
from pmopt.mechanisms.mechanism import wrap_angle
from pmopt.reporting.tables import kinematics as tables
from pmopt.reporting.tables.mobility import mobility_data, mobility_tables
from pmopt.reporting.tables.table import Table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes

    from pmopt.api.design import Design


def draw_at(design: Design, pose: Mapping[str, float], working_mode: str | None) -> Axes:
    """Return the axes of a picture of the mechanism at a pose."""
    from pmopt.reporting.pictures.drawing import draw_mechanism

    return axes_of(lambda: draw_mechanism(design.mechanism, design.parameters, pose, working_mode))


def _number(solution: int, count: int) -> int:
    if not 0 <= solution < count:
        raise InputError(f"plot: solution={solution} is not allowed: 0 to {count - 1} are there")
    return solution


class InverseResult(Showing, inverse.InverseResult):
    """All asked-for branches of the inverse kinematics at a pose."""

    _design: Design

    def _headline(self) -> str:
        """Return the result in one line."""
        inside = sum(self.within_limits)
        return (
            f"{self.mechanism}, {place_text(self.pose, self.units)}: {len(self.solutions)} "
            f"solution{'s' if len(self.solutions) != 1 else ''}, {inside} within limits"
        )

    def _tables(self) -> list[Table]:
        """Return the branches, a row each."""
        return [tables.inverse_table([self])]

    @named
    def plot(self, solution: int = 0) -> Axes:
        """Draw the mechanism in one of the solutions."""
        found = self.solutions[_number(solution, len(self.solutions))]
        return draw_at(self._design, self.pose, found.working_mode)


class ForwardResult(Showing, forward.ForwardResult):
    """The assembly modes for a set of joint positions, or the one nearest to a pose."""

    _design: Design

    def _headline(self) -> str:
        """Return the result in one line."""
        count = len(self.solutions)
        return (
            f"{self.mechanism}, {place_text(self.joints, self.units)}: {count} assembly "
            f"mode{'s' if count != 1 else ''}, {self.complete} complete"
        )

    def _tables(self) -> list[Table]:
        """Return the assembly modes, a row each."""
        return [tables.forward_table([self])]

    @named
    def plot(self, solution: int = 0) -> Axes:
        """Draw the mechanism in one of the assembly modes."""
        pose = self.solutions[_number(solution, len(self.solutions))].pose
        kinds = {c.name: c.kind for c in self._design.mechanism.joints}

        def apart(joints: Mapping[str, float]) -> float:
            return sum(
                (wrap_angle(joints[k] - v) if kinds[k] == "angle" else joints[k] - v) ** 2
                for k, v in self.joints.items()
            )

        branches = self._design.ik(pose).solutions
        mode = min(branches, key=lambda branch: apart(branch.joints)).working_mode
        return draw_at(self._design, pose, mode)


class JacobianResult(Showing, jacobian.JacobianResult):
    """Velocity maps and conditioning at a pose in one working mode."""

    _design: Design

    def _headline(self) -> str:
        """Return the result in one line."""
        singular = f"singular: {'; '.join(self.singular)}" if self.singular else "not singular"
        return (
            f"{self.mechanism}, {place_text(self.pose, self.units)}, {self.working_mode}: "
            f"LCI {self.lci:.6g} ({self.kind}, {self.norm}-norm), {singular}"
        )

    def _tables(self) -> list[Table]:
        """Return indices first, then the matrices."""
        return tables.jacobian_tables(self)

    def _frame(self, name: str) -> Table:
        """Return all numbers, a row each."""
        return tables.jacobian_data(self)

    @named
    def plot(self) -> Axes:
        """Draw the mechanism at the pose."""
        return draw_at(self._design, self.pose, self.working_mode)


class MobilityResult(Showing, freedom.MobilityResult):
    """All that the declared joints say of a mechanism's mobility."""

    frames: ClassVar[tuple[str, ...]] = ("counts", "systems", "loops", "about")
    _design: Design

    def _headline(self) -> str:
        """Return the result in one line."""
        return (
            f"{self.mechanism}, layout {self.layout}: freedom {self.freedom} ({self.kind}), "
            f"full-cycle {self.full_cycle.freedom}, Kutzbach-Gruebler "
            f"{self.kutzbach_gruebler.mobility}"
        )

    def _tables(self) -> list[Table]:
        """Return the counts, the systems of platform and limbs, and the loops."""
        return mobility_tables(self)

    def _frame(self, name: str) -> Table:
        """Return the table of that name."""
        return mobility_data(self)[self.frames.index(name)]

    @named
    def plot(self) -> Axes:
        """Draw the mechanism as declared, at the pose that was analysed or at home."""
        return draw_at(self._design, self.pose or self._design.home(), self.working_mode)
