"""A mechanism by name, and one design of it: validated once, with every analysis as a method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from pmopt.analysis.kinematics.forward import forward_kinematics
from pmopt.analysis.kinematics.inverse import inverse_kinematics, reached
from pmopt.analysis.kinematics.jacobian import jacobian_at
from pmopt.analysis.reads import Own, Reads
from pmopt.analysis.settings import SingularitySettings, TaskSettings, WorkspaceSettings
from pmopt.analysis.validation import read_config, validated
from pmopt.api.inputs import Number, with_sampling
from pmopt.api.keywords import (
    CapabilityOptions,
    CertifyOptions,
    CertifyVolumeOptions,
    JacobianOptions,
    MobilityOptions,
    Params,
    Ranges,
    RunOptions,
    SectionOptions,
    SingularityOptions,
    Values,
    WorkspaceOptions,
    named,
    settings_of,
)
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism, find
from pmopt.mechanisms.mechanism import Coordinate, Limb, Parameter, Reach

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from pmopt.analysis.motion.config import MotionTask
    from pmopt.analysis.regions.sections import Section
    from pmopt.api.results.certification import CertifiedVolume, Claim
    from pmopt.api.results.kinematics import (
        ForwardResult,
        InverseResult,
        JacobianResult,
        MobilityResult,
    )
    from pmopt.api.results.runs import MotionRun, SimulationRun
    from pmopt.api.results.singularities import SingularityResult
    from pmopt.api.results.sizing import Capability
    from pmopt.api.results.workspace import WorkspaceResult


#: Most points along an axis of a section.
_FINEST = 4000


@dataclass(frozen=True, repr=False)
class MechanismHandle:
    """A mechanism of the catalogue; :meth:`design` gives one design of it.

    Attributes
    ----------
    declaration : Mechanism
        All that it declares. Its attributes are those of the handle, too.
    """

    declaration: Mechanism

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.declaration.name

    @property
    def description(self) -> str:
        """Description of the mechanism, in one line."""
        return self.declaration.description

    @property
    def freedom(self) -> str:
        """Kind of its freedoms, e.g. ``1T2R``."""
        return self.declaration.freedom

    @property
    def length_unit(self) -> str:
        """The unit of its lengths: m or mm."""
        return self.declaration.length_unit

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Its parameters, with units, defaults, bounds and source."""
        return self.declaration.parameters

    @property
    def pose(self) -> tuple[Coordinate, ...]:
        """The coordinates of its pose."""
        return self.declaration.pose

    @property
    def joints(self) -> tuple[Coordinate, ...]:
        """Its actuated joints."""
        return self.declaration.joints

    @property
    def limbs(self) -> tuple[Limb, ...]:
        """Its limbs."""
        return self.declaration.limbs

    @property
    def working_modes(self) -> tuple[str, ...]:
        """Names of its working modes, the default one first."""
        return self.declaration.working_modes

    def design(self, params: Params | None = None, /, **parameters: Number | None) -> Design:
        """Return a design: parameters by keyword, or a mapping; the others take their defaults.

        Raises
        ------
        InputError
            For an unknown name, with the nearest, and a value out of its physical range.
        """
        twice = [name for name in parameters if name in (params or {})]
        if twice:
            raise InputError(f"{self.name}: {twice[0]} is given twice")
        given = {**(params or {}), **parameters}
        return Design(self.declaration, self.declaration.resolve(given, self.name))

    def __repr__(self) -> str:
        return f"<{self.name}: {self.freedom}, {self.description}>"

    def _repr_html_(self) -> str:
        from pmopt.reporting.tables.catalogue import mechanism_tables
        from pmopt.reporting.tables.html import to_html

        return to_html(mechanism_tables(self.declaration))

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name.startswith("_") or name == "declaration":
                raise AttributeError(name)
            return getattr(self.declaration, name)


@dataclass(frozen=True, repr=False)
class Design:
    """One design of a mechanism; every analysis is a method with the keywords of its function.

    Attributes
    ----------
    mechanism : Mechanism
    parameters : dict
        Complete and checked, in the mechanism's unit.
    """

    mechanism: Mechanism
    parameters: dict[str, float | None]

    @classmethod
    def of(cls, mechanism: str, params: Params | None = None) -> Design:
        """Return the design of a mechanism by its name."""
        found = find(mechanism)
        return cls(found, found.resolve(params or {}))

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter."""
        return {p.name: self.mechanism.unit(p) for p in self.mechanism.parameters}

    def home(self) -> dict[str, float]:
        """Return the home pose, in the mechanism's unit and rad."""
        return self.mechanism.home(self.parameters)

    def __repr__(self) -> str:
        from pmopt.reporting.tables.table import design_text

        return f"<{self.mechanism.name}: {design_text(self.parameters, self.units)}>"

    @named
    def ik(
        self, pose: Values, working_mode: str = "all", limits: Ranges | None = None
    ) -> InverseResult:
        """Solve the inverse kinematics at a pose, see :func:`pmopt.ik`."""
        from pmopt.api.results.kinematics import InverseResult

        found = inverse_kinematics(self.mechanism, self.parameters, pose, working_mode, limits)
        return InverseResult.of(found, design=self)

    @named
    def fk(self, joints: Values, near: Values | None = None) -> ForwardResult:
        """Solve the forward kinematics, see :func:`pmopt.fk`."""
        from pmopt.api.results.kinematics import ForwardResult

        found = forward_kinematics(self.mechanism, self.parameters, joints, near=near)
        return ForwardResult.of(found, design=self)

    @named
    def jacobian(
        self, pose: Values, working_mode: str | None = None, **options: Unpack[JacobianOptions]
    ) -> JacobianResult:
        """Compute the Jacobian and its conditioning at a pose, see :func:`pmopt.jacobian`."""
        from pmopt.api.results.kinematics import JacobianResult

        found = jacobian_at(self.mechanism, self.parameters, pose, working_mode, **options)
        return JacobianResult.of(found, design=self)

    @named
    def mobility(self, **options: Unpack[MobilityOptions]) -> MobilityResult:
        """Analyse the mobility from the declared joints, see :func:`pmopt.mobility`."""
        from pmopt.analysis.mobility.freedom import mobility_of
        from pmopt.api.results.kinematics import MobilityResult

        found = mobility_of(self.mechanism, self.parameters, **options)
        return MobilityResult.of(found, design=self)

    @named
    def workspace(self, **options: Unpack[WorkspaceOptions]) -> WorkspaceResult:
        """Sample the workspace, see :func:`pmopt.workspace`."""
        from pmopt.analysis.sampling.measuring import Course
        from pmopt.analysis.workspace.compute import compute_workspace
        from pmopt.analysis.workspace.emptiness import require_reachable
        from pmopt.api.results.workspace import WorkspaceResult
        from pmopt.execution.cluster import connect

        given = with_sampling(options, "workspace", frozenset())
        settings = self._settings(
            given, "workspace", ("seed", "threads", "shape_grid", "scheduler")
        )
        with connect(options.get("scheduler")) as cluster:
            result = compute_workspace(
                self.mechanism, self.parameters, settings, seed=options.get("seed", 1),
                threads=options.get("threads"), shape_grid=options.get("shape_grid"),
                course=Course(cluster=cluster),
            )  # fmt: skip
        require_reachable(
            result.reachable, self.mechanism, result.params, settings, "workspace", result.samples
        )
        return WorkspaceResult.of(result, design=self, threads=options.get("threads"))

    @named
    def sections(self, **options: Unpack[SectionOptions]) -> tuple[Section, ...]:
        """Evaluate LCI on plane sections of the workspace, as its pictures show them.

        Of three coordinates one section across each; of more, pairs through home, see
        :func:`pmopt.analysis.regions.sections.section_fields`.

        Parameters
        ----------
        **options
            Settings as of :meth:`workspace`, see :class:`pmopt.api.keywords.SectionOptions`;
            ``resolution``: points along each axis, 400 by default.
        """
        from pmopt.analysis.regions.sections import READS, section_fields
        from pmopt.analysis.sampling.sampler import make_sampler

        settings = self._read(READS, options, ("threads", "resolution")).of_workspace()
        resolution = options.get("resolution", 400)
        if not 2 <= resolution <= _FINEST:
            raise InputError(
                f"sections: resolution={resolution} is not allowed: 2 to {_FINEST} points"
            )
        sampler = make_sampler(
            self.mechanism, settings, threads=options.get("threads"), where="sections"
        )
        return section_fields(sampler, sampler.design(self.parameters), resolution)

    @named
    def reach(self, pose: Values) -> tuple[Reach, ...]:
        """Return how far a pose is within the reach of each limb, beyond it where negative.

        Raises
        ------
        pmopt.InputError
        """
        checked = self.mechanism.check_coordinates(pose, self.mechanism.pose, "pose")
        return self.mechanism.reach(self.parameters, checked)

    @named
    def singularities(self, **options: Unpack[SingularityOptions]) -> SingularityResult:
        """Map the singularities over the workspace, see :func:`pmopt.singularities`."""
        from pmopt.analysis.singularities.survey import READS, find_singularities
        from pmopt.api.results.singularities import SingularityResult

        given = with_sampling(options, "singularities", SingularitySettings.OWN)
        asked = self._read(READS, given, ("threads",))
        settings = asked.of_workspace()
        found = find_singularities(
            self.mechanism,
            self.parameters,
            settings,
            seed=asked.seed,
            threads=options.get("threads"),
            grid=asked.grid,
        )
        return SingularityResult.of(
            found, design=self, settings=settings, threads=options.get("threads")
        )

    @named
    def certify(self, **options: Unpack[CertifyOptions]) -> Claim:
        """Prove or refute a claim about the poses of a box, see :func:`pmopt.certify`."""
        from pmopt.analysis.certification.claim import READS, certify_claim
        from pmopt.api.results.certification import Claim

        asked = self._read(READS, options)
        settings = asked.of_workspace()
        found = certify_claim(
            self.mechanism,
            self.parameters,
            settings,
            time_budget=asked.time_budget if "time_budget" in options else 30.0,
            box_budget=asked.box_budget,
        )
        return Claim.of(found, design=self, settings=settings)

    @named
    def certify_volume(self, **options: Unpack[CertifyVolumeOptions]) -> CertifiedVolume:
        """Enclose the volume between guaranteed bounds, see :func:`pmopt.certify_volume`."""
        from pmopt.analysis.certification.volume import READS, certify_volume
        from pmopt.api.results.certification import CertifiedVolume

        asked = self._read(READS, options)
        settings = asked.of_workspace()
        found = certify_volume(
            self.mechanism,
            self.parameters,
            settings,
            gap=asked.gap,
            time_budget=asked.time_budget,
            box_budget=asked.box_budget,
        )
        return CertifiedVolume.of(found, design=self, settings=settings)

    @named
    def capability(self, **options: Unpack[CapabilityOptions]) -> Capability:
        """Sample the rates and efforts that a task needs, see :func:`pmopt.capability`."""
        from pmopt.analysis.sizing import actuators
        from pmopt.analysis.workspace.emptiness import require_reachable
        from pmopt.api.results.sizing import Capability
        from pmopt.mechanisms.bodies import point_mass
        from pmopt.reporting.runs.capability_run import CapabilityTask, compute

        given = settings_of(options, ("threads", "workspace"))
        given = {name: value for name, value in given.items() if (name, value) != ("motors", None)}
        task = validated(TaskSettings, given, "capability", self.mechanism.units)
        actuators.check_payload(task.payload, task.payload_centre, "capability: payload_centre")
        load = point_mass(task.payload, task.payload_centre) if task.payload else None
        poses = settings_of(options.get("workspace") or {}, ())
        settings = actuators.READS.settings(
            poses, "capability: workspace", self.mechanism.units
        ).of_workspace()
        sizes = {name: getattr(task, name) for name in actuators.SIZES}
        asked = CapabilityTask(
            self.mechanism, self.parameters, settings, actuators.Task(**sizes, payload=load),
            actuators.check_limits(self.mechanism, task.motors, "capability"), task.samples,
            task.seed,
        )  # fmt: skip
        result = compute(asked, options.get("threads"))
        require_reachable(
            result.reachable, self.mechanism, result.params, settings, "capability", result.samples
        )
        return Capability.of(result, asked=asked, threads=options.get("threads"))

    @named
    def motion(
        self,
        config: Mapping[str, object] | str | Path,
        out: str | Path | None = None,
        **options: Unpack[RunOptions],
    ) -> MotionRun:
        """Compute a motion of this design, see :func:`pmopt.motion`.

        The configuration needs neither ``mechanism`` nor ``[parameters]``; those of a file give
        way to this design.
        """
        from pmopt.api.results.runs import MotionRun
        from pmopt.reporting.runs.motion_run import run_motion

        folder = None if out is None else Path(out)
        return MotionRun.of(run_motion(self._motion_task(config), folder, **options))

    @named
    def simulate(
        self,
        config: Mapping[str, object] | str | Path,
        out: str | Path | None = None,
        **options: Unpack[RunOptions],
    ) -> SimulationRun:
        """Run a motion of this design on an engine, see :func:`pmopt.simulate`.

        For the configuration see :meth:`motion`.
        """
        from pmopt.api.results.runs import SimulationRun
        from pmopt.reporting.runs.simulate_run import run_simulation

        folder = None if out is None else Path(out)
        return SimulationRun.of(run_simulation(self._motion_task(config), folder, **options))

    @named
    def mjcf(
        self, pose: Values | None = None, working_mode: str | None = None, step: float = 0.001
    ) -> str:
        """Return this design with its own bodies as a MuJoCo model, see :func:`pmopt.mjcf`."""
        from pmopt.analysis.multibody.mjcf import to_mjcf
        from pmopt.analysis.multibody.model import declared_tree

        return to_mjcf(declared_tree(self.mechanism, self.parameters, pose, working_mode), step)

    @named
    def draw(
        self,
        pose: Values | None = None,
        working_mode: str | None = None,
        limits: Ranges | None = None,
    ) -> Axes:
        """Draw the mechanism at a pose, its home by default; return the axes of the picture.

        Raises
        ------
        pmopt.UnreachableError
        """
        from pmopt.api.results.kinematics import draw_at

        mode = self.mechanism.check_mode(working_mode)
        at = self.home() if pose is None else pose
        found = inverse_kinematics(self.mechanism, self.parameters, at, mode, limits)
        return draw_at(self, reached(self.mechanism, found, "pose").pose, mode)

    def _settings(
        self, options: Mapping[str, Any], where: str, own: tuple[str, ...]
    ) -> WorkspaceSettings:
        given = settings_of(options, own)
        return validated(WorkspaceSettings, given, where, self.mechanism.units)

    def _read(
        self, reads: Reads[Own], options: Mapping[str, Any], beside: tuple[str, ...] = ()
    ) -> Own:
        """Return an analysis's settings from the keywords that belong to them."""
        return reads.settings(settings_of(options, beside), reads.analysis, self.mechanism.units)

    def _motion_task(self, config: Mapping[str, object] | str | Path) -> MotionTask:
        from pmopt.analysis.motion.config import resolve_motion

        if isinstance(config, str | Path):
            path = Path(config)
            data, where, folder = read_config(path, "motion"), str(path), path.parent
        else:
            data, where, folder = dict(config), "config", Path()
            if "parameters" in data:
                raise InputError(f"{where}: parameters are those of the design: leave them out")
        name = data.get("mechanism", self.mechanism.name)
        if not isinstance(name, str) or find(name).name != self.mechanism.name:
            raise InputError(f"{where}: mechanism={name!r} is not that of the design: "
                             f"{self.mechanism.name}")  # fmt: skip
        own = {"mechanism": self.mechanism.name, "parameters": self.parameters}
        return resolve_motion({**data, **own}, where, folder)
