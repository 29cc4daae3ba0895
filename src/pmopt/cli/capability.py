"""``pmopt capability``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from pmopt.cli import options
from pmopt.cli.output import emit, notifier
from pmopt.errors import InputError
from pmopt.mechanisms import Mechanism


def _size(name: str, unit: str, text: str) -> Callable[[options.Function], options.Function]:
    wanted = options.Quantity(unit.replace("length unit", "length"))
    return click.option(f"--{name}", type=wanted, default=0.0, metavar="X", help=f"{text}, {unit}.")


@click.command("capability")
@options.mechanism_argument
@options.params_option
@_size(
    "speed",
    "length unit/s",
    "Speed of the pose's translational coordinates, as one vector in "
    "any direction; others, parasitic ones too, only follow",
)
@_size("turn", "rad/s", "Rate of the pose's angles, as one vector in any direction")
@_size("acceleration", "length unit/s^2", "Acceleration of the pose's translational coordinates")
@_size("angular-acceleration", "rad/s^2", "Acceleration of the pose's angles")
@_size(
    "point-speed",
    "length unit/s",
    "Instead of coordinates: speed of the platform's centre in "
    "any direction that it can move, with the least turning",
)
@_size(
    "rotation-speed",
    "rad/s",
    "Instead of coordinates: angular speed of the platform about any "
    "axis that it can turn about; with --point-speed all motions within both",
)
@_size("point-acceleration", "length unit/s^2", "Acceleration of the platform's centre alike")
@_size("rotation-acceleration", "rad/s^2", "Angular acceleration of the platform alike")
@_size("tool-force", "N", "Force on the platform's centre in any direction")
@_size("payload", "kg", "Mass on the platform")
@click.option(
    "--payload-centre",
    metavar="X,Y,Z",
    default="0,0,0",
    show_default=True,
    help="Where the payload is, in the platform's frame and the length unit.",
)
@click.option(
    "--motors",
    multiple=True,
    metavar="NAME=VALUE,..",
    help="What the joints can do: <joint>_rate (length unit/s, rad/s) and "
    "<joint>_effort (N, N m). Default: no limits, only what is needed is told.",
)
@click.option(
    "--samples",
    type=options.Count(),
    metavar="N",
    default=65536,
    show_default=True,
    help="Sample points.",
)
@options.seed_option
@click.option("--working-mode", metavar="MODE", help="See pmopt info MECH. Default: its first.")
@click.option(
    "--domain",
    multiple=True,
    metavar="COORD=LOWER:UPPER,..",
    help="Bounds on pose coordinates; inf is allowed.",
)
@click.option("--limits", multiple=True, metavar="JOINT=LOWER:UPPER,..", help="Bounds on joints.")
@options.threads_option
@options.out_options
@options.common_options
def capability_command(
    mechanism: Mechanism, params: tuple[str, ...], speed: float, turn: float, acceleration: float,
    angular_acceleration: float, point_speed: float, rotation_speed: float,
    point_acceleration: float, rotation_acceleration: float, tool_force: float, payload: float,
    payload_centre: str,
    motors: tuple[str, ...], samples: int, seed: int, working_mode: str | None,
    domain: tuple[str, ...], limits: tuple[str, ...], threads: int | None, out: Path | None,
    force: bool, form: str, quiet: bool, debug: bool,
) -> None:  # fmt: skip
    """Rates and efforts that a payload and a speed ask for, and where given motors suffice.

    \b
    Example:
      pmopt capability 2pauu-ppap --payload 2 --speed 1 --motors theta1_effort=300,theta1_rate=6
    """
    from pmopt.analysis.settings import WorkspaceSettings
    from pmopt.analysis.sizing.actuators import Task, check_limits, check_payload
    from pmopt.analysis.validation import validated
    from pmopt.mechanisms.bodies import point_mass
    from pmopt.reporting.runs import capability_run

    sizes = {
        "speed": speed, "turn": turn, "acceleration": acceleration,
        "angular-acceleration": angular_acceleration, "point-speed": point_speed,
        "rotation-speed": rotation_speed, "point-acceleration": point_acceleration,
        "rotation-acceleration": rotation_acceleration, "tool-force": tool_force,
        "payload": payload,
    }  # fmt: skip
    for name, value in sizes.items():
        if not 0 <= value < 1e9:
            raise InputError(f"--{name}: {value} is not allowed: a number from 0 to 1e9 is needed")
    place = options.parse_point(payload_centre, "--payload-centre", mechanism.length_unit)
    check_payload(payload, place, "--payload-centre")
    given: dict[str, Any] = {
        "working_mode": working_mode,
        "domain": options.parse_ranges(domain, "--domain", mechanism),
        "limits": options.parse_ranges(limits, "--limits", mechanism),
    }
    settings = validated(
        WorkspaceSettings, {k: v for k, v in given.items() if v is not None}, "capability"
    )
    motor_limits = check_limits(mechanism, options.split_pairs(motors, "--motors"), "--motors")
    notify = notifier(quiet)
    asked = capability_run.CapabilityTask(
        mechanism,
        options.design_parameters(mechanism, params),
        settings,
        Task(
            speed, acceleration, turn, angular_acceleration, tool_force,
            point_mass(payload, place) if payload else None,
            point_speed, point_acceleration, rotation_speed, rotation_acceleration,
        ),
        motor_limits, samples, seed,
    )  # fmt: skip
    result = capability_run.run_capability(asked, out, force=force, threads=threads, notify=notify)
    emit(
        form, result.to_dict(), capability_run.capability_tables(result),
        capability_run.capability_data(result),
    )  # fmt: skip
    if out is not None:
        notify(f"written to {out}")
