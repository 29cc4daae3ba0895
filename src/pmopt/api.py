"""The public Python interface: mechanisms by name, keywords instead of settings objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmopt.analysis.kinematics.solve import (
    ForwardResult,
    InverseResult,
    JacobianResult,
    forward_kinematics,
    inverse_kinematics,
    jacobian_at,
)
from pmopt.analysis.validation import validated
from pmopt.errors import unknown_name
from pmopt.mechanisms import Mechanism, find, names

if TYPE_CHECKING:
    from pmopt.analysis.certification.boxes import CertifiedVolume, Claim
    from pmopt.analysis.mobility.freedom import MobilityResult
    from pmopt.analysis.motion.config import MotionTask
    from pmopt.analysis.singularities.survey import SingularityResult
    from pmopt.analysis.sizing.actuators import Capability
    from pmopt.analysis.workspace.compute import WorkspaceResult
    from pmopt.reporting.batch.summary import BatchResult
    from pmopt.reporting.runs.motion_run import MotionRun
    from pmopt.reporting.runs.pareto_run import ParetoRun
    from pmopt.reporting.runs.simulate_run import SimulationRun

Params = Mapping[str, Any]


def mechanism_names() -> list[str]:
    """Return the names of all mechanisms."""
    return names()


def mechanism(name: str) -> Mechanism:
    """Return a mechanism by name, ignoring case, spaces and dashes."""
    return find(name)


def ik(
    mechanism: str,
    pose: Params,
    params: Params | None = None,
    working_mode: str = "all",
    limits: Params | None = None,
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
    pmopt.errors.UnreachableError
        Where the limbs cannot be closed, naming the limb and by how much the pose is out of its
        reach. What only exceeds limits or strokes is listed, see ``within_limits`` and ``beyond``.
    """
    return inverse_kinematics(find(mechanism), params, pose, working_mode, limits)


def fk(
    mechanism: str, joints: Params, params: Params | None = None, near: Params | None = None
) -> ForwardResult:
    """Solve the forward kinematics: all assembly modes, or the one nearest to a pose.

    :func:`pmopt.analysis.kinematics.solve.forward_many` solves many sets of joint positions.

    Raises
    ------
    pmopt.errors.UnreachableError
        Where the mechanism can not be assembled with these joint positions.
    """
    return forward_kinematics(find(mechanism), params, joints, near=near)


def jacobian(
    mechanism: str,
    pose: Params,
    params: Params | None = None,
    working_mode: str | None = None,
    **options: Any,
) -> JacobianResult:
    """Compute the Jacobian and its conditioning at a pose.

    Parameters
    ----------
    mechanism, pose, params, working_mode
        See :func:`ik`.
    **options
        ``kind``, ``characteristic_length``, ``norm`` and ``limits`` of
        :func:`pmopt.analysis.kinematics.solve.jacobian_at`.
    """
    return jacobian_at(find(mechanism), params, pose, working_mode, **options)


def mobility(mechanism: str, params: Params | None = None, **options: Any) -> MobilityResult:
    """Analyse the mobility from the declared joints.

    Parameters
    ----------
    mechanism : str
    params : mapping, optional
        Design parameters; those left out take their defaults.
    **options
        ``layout``, ``pose``, ``working_mode``, ``samples`` and ``seed`` of
        :func:`pmopt.analysis.mobility.freedom.mobility_of`.
    """
    from pmopt.analysis.mobility.freedom import mobility_of

    return mobility_of(find(mechanism), params, **options)


def workspace(
    mechanism: str,
    params: Params | None = None,
    *,
    seed: int = 1,
    threads: int | None = None,
    shape_grid: int | None = None,
    scheduler: str | None = None,
    **settings: Any,
) -> WorkspaceResult:
    """Sample the workspace of one design.

    Parameters
    ----------
    mechanism : str
    params : mapping, optional
        Design parameters; those left out take their defaults.
    seed : int
    threads : int, optional
        The result is the same for any number.
    shape_grid : int, optional
        Cells per axis on which pieces and voids are counted; 0 leaves the shape out.
    scheduler : str, optional
        Address of a Dask scheduler whose workers sample; the result is the same.
    **settings
        Fields of :class:`pmopt.analysis.settings.WorkspaceSettings`: ``samples``, ``sampler``,
        ``grid``, ``target_error``, ``working_mode``, ``norm``, ``jacobian``, ``domain``, ..

    Raises
    ------
    pmopt.errors.InfeasibleError
        When nothing is reachable, with what rules it out.
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.workspace.compute import compute_workspace
    from pmopt.analysis.workspace.emptiness import require_reachable
    from pmopt.execution.cluster import connect

    found = find(mechanism)
    checked = validated(WorkspaceSettings, settings, "workspace", found.units)
    with connect(scheduler) as cluster:
        result = compute_workspace(
            found, params, checked, seed=seed, threads=threads, shape_grid=shape_grid,
            cluster=cluster,
        )  # fmt: skip
    require_reachable(result.reachable, found, result.params, checked, "workspace", result.samples)
    return result


def certify_volume(
    mechanism: str,
    params: Params | None = None,
    *,
    gap: float = 1e-2,
    time_budget: float | None = None,
    box_budget: int | None = None,
    **settings: Any,
) -> CertifiedVolume:
    """Enclose the volume of one design's workspace between guaranteed bounds.

    Parameters
    ----------
    mechanism, params
        See :func:`workspace`.
    gap : float
        Relative gap between the bounds that is asked for.
    time_budget : float, optional
        Seconds of work after which the bounds so far are returned; compilation does not count.
    box_budget : int, optional
        Boxes examined after which they are: the same on every machine.
    **settings
        ``working_mode``, ``domain`` and ``limits`` of
        :class:`pmopt.analysis.settings.WorkspaceSettings`.
    """
    from pmopt.analysis.certification import boxes
    from pmopt.analysis.settings import WorkspaceSettings

    return boxes.certify_volume(
        find(mechanism),
        params,
        validated(WorkspaceSettings, settings, "certify", find(mechanism).units),
        gap=gap,
        time_budget=time_budget,
        box_budget=box_budget,
    )


def certify(
    mechanism: str,
    params: Params | None = None,
    *,
    time_budget: float | None = 30.0,
    box_budget: int | None = None,
    **settings: Any,
) -> Claim:
    """Prove or refute LCI >= ``min_lci`` at every reachable pose of a box.

    Without ``min_lci`` the claim is that no reachable pose of it is singular.

    Parameters
    ----------
    mechanism, params
        See :func:`workspace`.
    time_budget : float, optional
        Seconds of work after which the claim is left undecided; compilation does not count.
    box_budget : int, optional
        Boxes examined after which it is: with ``time_budget=None`` the verdict is the same on every
        machine.
    **settings
        ``min_lci``, ``domain``, ``limits``, ``working_mode``, ``norm``, ``jacobian`` and
        ``characteristic_length`` of :class:`pmopt.analysis.settings.WorkspaceSettings`.
    """
    from pmopt.analysis.certification.boxes import certify_claim
    from pmopt.analysis.settings import WorkspaceSettings

    return certify_claim(
        find(mechanism),
        params,
        validated(WorkspaceSettings, settings, "certify", find(mechanism).units),
        time_budget=time_budget,
        box_budget=box_budget,
    )


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
    from pmopt.analysis.kinematics.solve import Assembling, Inverting
    from pmopt.analysis.motion.dynamics import Mover
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.workspace.sweeper import Sweeper
    from pmopt.analysis.workspace.warmup import warm_up
    from pmopt.execution.threads import default_threads

    told: set[str] = set()

    def once(line: str) -> None:
        if notify is not None and line not in told:
            told.add(line)
            notify(line)

    users: list[Sweeper | Mover | Assembling | Inverting] = []
    for name in mechanisms or names():
        found = find(name)
        users.append(Sweeper(found, WorkspaceSettings(), notify=once))
        if found.line is not None:
            users.append(Sweeper(found, WorkspaceSettings(sampler="lines"), notify=once))
        if found.posture is not None:
            users.append(Mover(found, found.resolve({}), found.working_modes[0]))
        if found.assembler is not None:
            users.append(Assembling(found))
        if found.inverter is not None:
            users.append(Inverting(found))
    return warm_up(users, threads or default_threads(), progress=progress)


def singularities(
    mechanism: str,
    params: Params | None = None,
    *,
    seed: int = 1,
    threads: int | None = None,
    grid: int | None = None,
    **settings: Any,
) -> SingularityResult:
    """Map the singularities of one design over its workspace.

    Parameters
    ----------
    mechanism, params, seed, threads, **settings
        See :func:`workspace`.
    grid : int, optional
        Cells along each axis on which aspects are told apart.
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.singularities.survey import find_singularities

    return find_singularities(
        find(mechanism),
        params,
        validated(WorkspaceSettings, settings, "singularities", find(mechanism).units),
        seed=seed,
        threads=threads,
        grid=grid,
    )


def capability(
    mechanism: str,
    params: Params | None = None,
    *,
    motors: Params | None = None,
    payload: float = 0.0,
    payload_centre: Sequence[float] = (0.0, 0.0, 0.0),
    samples: int = 1 << 16,
    seed: int = 1,
    threads: int | None = None,
    workspace: Params | None = None,
    **task: float,
) -> Capability:
    """Sample the rates and efforts that a task asks for, and where given motors suffice.

    Parameters
    ----------
    mechanism : str
    params : mapping, optional
        Design parameters; those left out take their defaults.
    motors : mapping, optional
        ``<joint>_rate`` (length unit/s, rad/s) and ``<joint>_effort`` (N, N m) that there are.
    payload : float
        kg, at ``payload_centre`` in the platform's frame and the length unit; the centre needs one.
    samples, seed, threads
        Sample points, their seed, and threads, which change nothing.
    workspace : mapping, optional
        Settings of the workspace: domain, limits, working_mode and what else
        :data:`pmopt.analysis.sizing.actuators.READS` names.
    **task : float
        ``speed``, ``acceleration``, ``turn``, ``angular_acceleration`` of the pose's coordinates,
        or ``point_speed``, ``point_acceleration``, ``rotation_speed``, ``rotation_acceleration``
        of the platform; ``force``; see :class:`pmopt.analysis.sizing.actuators.Task`.

    Raises
    ------
    pmopt.errors.InfeasibleError
        When nothing is reachable, with what rules it out.
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.sizing.actuators import SIZES, Task, check_payload, compute_capability
    from pmopt.analysis.workspace.emptiness import require_reachable
    from pmopt.mechanisms.bodies import point_mass

    found = find(mechanism)
    for name in task:
        if name not in SIZES:
            raise unknown_name("capability", name, SIZES)
    check_payload(payload, payload_centre, "capability: payload_centre")
    load = point_mass(payload, payload_centre) if payload else None
    settings = validated(
        WorkspaceSettings, dict(workspace or {}), "capability: workspace", found.units
    )
    result = compute_capability(
        found,
        found.resolve(params or {}),
        settings,
        Task(**task, payload=load),
        motors or {},
        samples=samples, seed=seed, threads=threads,
    )  # fmt: skip
    require_reachable(
        result.reachable, found, result.params, settings, "capability", result.samples
    )
    return result


def motion(config: Params | str | Path, out: str | Path | None = None, **options: Any) -> MotionRun:
    """Compute the motion that a configuration describes, with efforts and power.

    Parameters
    ----------
    config : mapping or path
        As in the TOML file, or the file.
    out : path, optional
        The run's folder; nothing is written without it, nor of an infeasible motion.
    **options
        ``force``, ``threads`` of :func:`pmopt.reporting.runs.motion_run.run_motion`.
    """
    from pmopt.reporting.runs.motion_run import run_motion

    return run_motion(_motion_task(config), None if out is None else Path(out), **options)


def simulate(
    config: Params | str | Path, out: str | Path | None = None, **options: Any
) -> SimulationRun:
    """Run the motion that a configuration describes on an independent multibody engine.

    Parameters
    ----------
    config : mapping or path
        As in the TOML file, or the file.
    out : path, optional
        The run's folder; nothing is written without it.
    **options
        ``force``, ``threads`` of :func:`pmopt.reporting.runs.simulate_run.run_simulation`.

    Raises
    ------
    pmopt.errors.PmoptError
        Where the engine is not installed: it comes with ``pmopt[engines]``.
    """
    from pmopt.reporting.runs.simulate_run import run_simulation

    return run_simulation(_motion_task(config), None if out is None else Path(out), **options)


def mjcf(
    mechanism: str,
    pose: Params | None = None,
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
    from pmopt.analysis.multibody.mjcf import to_mjcf
    from pmopt.analysis.multibody.model import declared_tree

    return to_mjcf(declared_tree(find(mechanism), params, pose, working_mode), step)


def _motion_task(config: Params | str | Path) -> MotionTask:
    from pmopt.analysis.motion.config import load_motion, resolve_motion

    if isinstance(config, str | Path):
        return load_motion(Path(config))
    return resolve_motion(dict(config), "config", Path())


def pareto(
    config: Params | str | Path,
    out: str | Path | None = None,
    *,
    scheduler: str | None = None,
    **options: Any,
) -> ParetoRun:
    """Search for the Pareto front of a configuration.

    Parameters
    ----------
    config : mapping or path
        As in the TOML file, or the file.
    out : path, optional
        The run's folder; nothing is written without it.
    scheduler : str, optional
        Address of a Dask scheduler whose workers evaluate; the result is the same.
    **options
        ``force``, ``resume``, ``threads`` of :func:`pmopt.reporting.runs.pareto_run.run_pareto`.
    """
    from pmopt.execution.cluster import connect
    from pmopt.reporting.runs.pareto_run import run_pareto
    from pmopt.synthesis.config import load_config, resolve_config

    if isinstance(config, str | Path):
        resolved = load_config(Path(config))
    else:
        resolved = resolve_config(dict(config), "config")
    with connect(scheduler) as cluster:
        return run_pareto(resolved, None if out is None else Path(out), cluster=cluster, **options)


def batch(
    configs: str | Path | Sequence[str | Path], out: str | Path | None = None, **options: Any
) -> BatchResult:
    """Run many configurations, or what is not done of them, each in its own folder.

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
    from pmopt.reporting.batch.run import run_batch
    from pmopt.reporting.runs.run_folder import default_folder

    several = [configs] if isinstance(configs, str | Path) else configs
    folder = default_folder("batch") if out is None else Path(out)
    return run_batch([str(config) for config in several], folder, **options)
