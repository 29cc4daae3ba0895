"""The public functions: a mechanism by name, keywords instead of settings objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from pmopt.api.design import Design, MechanismHandle
from pmopt.api.keywords import (
    BatchOptions,
    CapabilityOptions,
    CertifyOptions,
    CertifyVolumeOptions,
    JacobianOptions,
    MobilityOptions,
    Params,
    ParetoOptions,
    Ranges,
    RunOptions,
    SingularityOptions,
    Values,
    WorkspaceOptions,
    named,
)
from pmopt.mechanisms import find, names

if TYPE_CHECKING:
    from pmopt.analysis.motion.config import MotionTask
    from pmopt.api.results.certification import CertifiedVolume, Claim
    from pmopt.api.results.kinematics import (
        ForwardResult,
        InverseResult,
        JacobianResult,
        MobilityResult,
    )
    from pmopt.api.results.runs import BatchResult, MotionRun, ParetoRun, SimulationRun
    from pmopt.api.results.singularities import SingularityResult
    from pmopt.api.results.sizing import Capability
    from pmopt.api.results.workspace import WorkspaceResult

#: A configuration as in its TOML file, or the file.
Config = Mapping[str, object] | str | Path


def mechanism_names() -> list[str]:
    """Return the names of all mechanisms."""
    return names()


def mechanism(name: str) -> MechanismHandle:
    """Return a mechanism by name, ignoring case, spaces and dashes.

    Raises
    ------
    pmopt.InputError
        For an unknown name, with the nearest one.
    """
    return MechanismHandle(find(name))


@named
def ik(
    mechanism: str,
    pose: Values,
    params: Params | None = None,
    working_mode: str = "all",
    limits: Ranges | None = None,
) -> InverseResult:
    """Solve the inverse kinematics at a pose.

    Parameters
    ----------
    mechanism : str
    pose : mapping
        Every pose coordinate, in the mechanism's length unit and rad.
    params : mapping, optional
        Design parameters; those left out take their defaults.
    working_mode : str
        One of the mechanism's, or ``"all"``.
    limits : mapping, optional
        ``{joint: (lower, upper)}``.

    Raises
    ------
    pmopt.UnreachableError
        Where the limbs cannot be closed, naming the limb and by how much the pose is out of its
        reach. What only exceeds limits or strokes is listed, see ``within_limits`` and ``beyond``.
    """
    return Design.of(mechanism, params).ik(pose, working_mode, limits)


@named
def fk(
    mechanism: str, joints: Values, params: Params | None = None, near: Values | None = None
) -> ForwardResult:
    """Solve the forward kinematics: all assembly modes, or the one nearest to a pose.

    Raises
    ------
    pmopt.UnreachableError
        Where the mechanism cannot be assembled with these joint positions.
    """
    return Design.of(mechanism, params).fk(joints, near)


@named
def jacobian(
    mechanism: str,
    pose: Values,
    params: Params | None = None,
    working_mode: str | None = None,
    **options: Unpack[JacobianOptions],
) -> JacobianResult:
    """Compute the Jacobian and its conditioning at a pose.

    Parameters
    ----------
    mechanism, pose, params, working_mode
        See :func:`ik`.
    **options
        ``kind``, ``characteristic_length``, ``norm``, ``limits``: see
        :func:`pmopt.analysis.kinematics.jacobian.jacobian_at`.
    """
    return Design.of(mechanism, params).jacobian(pose, working_mode, **options)


@named
def mobility(
    mechanism: str, params: Params | None = None, **options: Unpack[MobilityOptions]
) -> MobilityResult:
    """Analyse the mobility from the declared joints.

    Parameters
    ----------
    mechanism : str
    params : mapping, optional
        Design parameters; those left out take their defaults.
    **options
        ``layout``, ``pose``, ``working_mode``, ``samples``, ``seed``: see
        :func:`pmopt.analysis.mobility.freedom.mobility_of`.
    """
    return Design.of(mechanism, params).mobility(**options)


@named
def workspace(
    mechanism: str, params: Params | None = None, **options: Unpack[WorkspaceOptions]
) -> WorkspaceResult:
    """Sample the workspace of one design.

    Parameters
    ----------
    mechanism : str
    params : mapping, optional
        Design parameters; those left out take their defaults.
    **options
        ``sampling``: a :class:`pmopt.Sampling`, or its ``samples``, ``sampler``, ``grid``,
        ``target_error``; ``working_mode``, ``norm``,
        ``jacobian``, ``domain``, ``limits``, .. of
        :class:`pmopt.analysis.settings.WorkspaceSettings`; ``seed``, ``threads``, ``shape_grid``
        and ``scheduler``, see :class:`pmopt.api.keywords.WorkspaceOptions`.

    Raises
    ------
    pmopt.InfeasibleError
        When nothing is reachable, with what rules it out.
    """
    return Design.of(mechanism, params).workspace(**options)


@named
def certify_volume(
    mechanism: str, params: Params | None = None, **options: Unpack[CertifyVolumeOptions]
) -> CertifiedVolume:
    """Enclose the volume of one design's workspace between guaranteed bounds.

    Parameters
    ----------
    mechanism, params
        See :func:`workspace`.
    **options
        ``gap``: relative gap between the bounds that is asked for, 0.01 by default;
        ``time_budget``: seconds of work after which the bounds so far are returned, compilation
        does not count; ``box_budget``: boxes examined after which they are, the same on every
        machine; ``working_mode``, ``domain``, ``limits``, and ``norm``, ``jacobian`` and
        ``characteristic_length`` of the index.
    """
    return Design.of(mechanism, params).certify_volume(**options)


@named
def certify(
    mechanism: str, params: Params | None = None, **options: Unpack[CertifyOptions]
) -> Claim:
    """Prove or refute LCI >= ``min_lci`` at every reachable pose of a box.

    Without ``min_lci`` the claim is that no reachable pose of it is singular.

    Parameters
    ----------
    mechanism, params
        See :func:`workspace`.
    **options
        ``min_lci``, ``domain``, ``limits``, ``working_mode``, ``norm``, ``jacobian`` and
        ``characteristic_length``; ``time_budget``: seconds of work after which the claim is left
        undecided, 30 by default, compilation does not count; ``box_budget``: boxes examined after
        which it is: with ``time_budget=None`` the verdict is the same on every machine.
    """
    return Design.of(mechanism, params).certify(**options)


@named
def warmup(
    *mechanisms: str,
    threads: int | None = None,
    notify: Callable[[str], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, int]:
    """Compile the kernels of mechanisms ahead.

    What motions, many poses and default workspaces need.

    Parameters
    ----------
    *mechanisms : str
        None for all.
    threads : int, optional
        Compilations at once.
    notify : callable, optional
        Receives a line for each mechanism that is compiled.
    progress : callable, optional
        Receives how many kernels are compiled and how many were missing.

    Returns
    -------
    dict
        By mechanism, the number of kernels that were missing.
    """
    from pmopt.analysis.kinematics.forward import Assembling
    from pmopt.analysis.kinematics.inverse import Inverting
    from pmopt.analysis.motion.dynamics import Mover
    from pmopt.analysis.sampling.design_space import DesignSpace
    from pmopt.analysis.sampling.evaluator import Evaluator
    from pmopt.analysis.sampling.warmup import warm_up
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.execution.threads import default_threads

    sent: set[str] = set()

    def once(line: str) -> None:
        if notify is not None and line not in sent:
            sent.add(line)
            notify(line)

    users: list[Evaluator | Mover | Assembling | Inverting] = []
    for name in mechanisms or names():
        found = find(name)
        users.append(Evaluator.of(DesignSpace.of(found, WorkspaceSettings()), notify=once))
        if found.line is not None:
            users.append(
                Evaluator.of(DesignSpace.of(found, WorkspaceSettings(sampler="lines")), notify=once)
            )
        if found.posture is not None:
            users.append(Mover(found, found.resolve({}), found.working_modes[0]))
        if found.assembler is not None:
            users.append(Assembling(found))
        if found.inverter is not None:
            users.append(Inverting(found))
    return warm_up(users, threads or default_threads(), progress=progress)


@named
def singularities(
    mechanism: str, params: Params | None = None, **options: Unpack[SingularityOptions]
) -> SingularityResult:
    """Map the singularities of one design over its workspace.

    Parameters
    ----------
    mechanism, params
        See :func:`workspace`.
    **options
        ``working_mode``, ``domain``, ``limits``, ``samples``, .. as of :func:`workspace`, see
        :class:`pmopt.api.keywords.SingularityOptions`; ``grid``: cells along each axis on which
        aspects are distinguished.
    """
    return Design.of(mechanism, params).singularities(**options)


@named
def capability(
    mechanism: str, params: Params | None = None, **options: Unpack[CapabilityOptions]
) -> Capability:
    """Sample the rates and efforts that a task asks for, and where given motors suffice.

    Parameters
    ----------
    mechanism : str
    params : mapping, optional
        Design parameters; those left out take their defaults.
    **options
        ``motors``: ``<joint>_rate`` (length unit/s, rad/s) and ``<joint>_effort`` (N, N m) that
        there are; ``payload`` in kg, at ``payload_centre`` in the platform's frame and the length
        unit; ``samples``, ``seed``; ``threads``, which change nothing; ``workspace``: domain,
        limits, working_mode and what else :class:`pmopt.api.keywords.CapabilityWorkspace` names.
        The task: ``speed``, ``acceleration``, ``turn``, ``angular_acceleration`` of the pose's
        coordinates, or ``point_speed``, ``point_acceleration``, ``rotation_speed``,
        ``rotation_acceleration`` of the platform; ``force``; see
        :class:`pmopt.analysis.sizing.actuators.Task`.

    Raises
    ------
    pmopt.InfeasibleError
        When nothing is reachable, with what rules it out.
    """
    return Design.of(mechanism, params).capability(**options)


@named
def motion(
    config: Config, out: str | Path | None = None, **options: Unpack[RunOptions]
) -> MotionRun:
    """Compute the motion that a configuration describes, with efforts and power.

    Parameters
    ----------
    config : mapping or path
        As in the TOML file, or the file.
    out : path, optional
        The run's folder; nothing is written without it, nor of an infeasible motion.
    **options
        ``force``: overwrite a run in the folder; ``threads``.
    """
    from pmopt.api.results.runs import MotionRun
    from pmopt.reporting.runs.motion_run import run_motion

    folder = None if out is None else Path(out)
    return MotionRun.of(run_motion(_motion_task(config), folder, **options))


@named
def simulate(
    config: Config, out: str | Path | None = None, **options: Unpack[RunOptions]
) -> SimulationRun:
    """Run the motion that a configuration describes on an independent multibody engine.

    Parameters
    ----------
    config : mapping or path
        As in the TOML file, or the file.
    out : path, optional
        The run's folder; nothing is written without it.
    **options
        ``force``: overwrite a run in the folder; ``threads``.

    Raises
    ------
    pmopt.PmoptError
        Where the engine is not installed: it comes with ``pmopt[engines]``.
    """
    from pmopt.api.results.runs import SimulationRun
    from pmopt.reporting.runs.simulate_run import run_simulation

    folder = None if out is None else Path(out)
    return SimulationRun.of(run_simulation(_motion_task(config), folder, **options))


@named
def mjcf(
    mechanism: str,
    pose: Values | None = None,
    params: Params | None = None,
    working_mode: str | None = None,
    step: float = 0.001,
) -> str:
    """Return a mechanism with its own bodies as a MuJoCo model, XML text.

    Parameters
    ----------
    mechanism : str
    pose : mapping, optional
        Where it stands; default: its home.
    params : mapping, optional
        Design parameters; those left out take their defaults.
    working_mode : str, optional
        Default: the mechanism's first.
    step : float
        The engine's step in s.
    """
    return Design.of(mechanism, params).mjcf(pose, working_mode, step)


def _motion_task(config: Config) -> MotionTask:
    from pmopt.analysis.motion.config import load_motion, resolve_motion

    if isinstance(config, str | Path):
        return load_motion(Path(config))
    return resolve_motion(dict(config), "config", Path())


@named
def pareto(
    config: Config, out: str | Path | None = None, **options: Unpack[ParetoOptions]
) -> ParetoRun:
    """Search for the Pareto front of a configuration.

    Parameters
    ----------
    config : mapping or path
        As in the TOML file, or the file.
    out : path, optional
        The run's folder; nothing is written without it.
    **options
        ``force``: overwrite a run in the folder; ``resume``: take it up; ``threads``;
        ``scheduler``: address of a Dask scheduler whose workers evaluate; the result is the same.
    """
    from pmopt.api.results.runs import ParetoRun
    from pmopt.execution.cluster import connect
    from pmopt.reporting.runs.pareto_run import run_pareto
    from pmopt.synthesis.config import load_config, resolve_config

    if isinstance(config, str | Path):
        resolved = load_config(Path(config))
    else:
        resolved = resolve_config(dict(config), "config")
    with connect(options.get("scheduler")) as cluster:
        found = run_pareto(
            resolved, None if out is None else Path(out), cluster=cluster,
            force=options.get("force", False), resume=options.get("resume", False),
            threads=options.get("threads"),
        )  # fmt: skip
    return ParetoRun.of(found, config=resolved)


@named
def batch(
    configs: str | Path | Sequence[str | Path],
    out: str | Path | None = None,
    **options: Unpack[BatchOptions],
) -> BatchResult:
    """Run many configurations, or those not yet done, each in its own folder.

    Parameters
    ----------
    configs : path or sequence of paths
        Files and globs.
    out : path, optional
        The batch's folder; default: a new one in ``outputs``.
    **options
        ``workers``, ``threads``, ``scheduler``, ``shard``, ``force`` and ``notify`` of
        :func:`pmopt.reporting.batch.run.run_batch`.
    """
    from pmopt.api.results.runs import BatchResult
    from pmopt.reporting.batch.run import run_batch
    from pmopt.reporting.runs.run_folder import default_folder

    several = [configs] if isinstance(configs, str | Path) else configs
    folder = default_folder("batch") if out is None else Path(out)
    return BatchResult.of(run_batch([str(config) for config in several], folder, **options))
