"""The commands, loaded on use."""

from __future__ import annotations

import importlib
import shlex

import click

from pmopt.errors import InputError, unknown_name
from pmopt.version import __version__

#: Subcommand -> (module, one-line help): the help is shown without importing the module.
COMMANDS = {
    "list": ("pmopt.cli.catalogue", "The catalogue of mechanisms."),
    "info": ("pmopt.cli.catalogue", "What one mechanism declares."),
    "ik": ("pmopt.cli.pose", "Inverse kinematics: joint positions of a pose."),
    "fk": ("pmopt.cli.pose", "Forward kinematics: poses of joint positions."),
    "jacobian": ("pmopt.cli.pose", "Jacobian, LCI and distance to singularities at a pose."),
    "check": ("pmopt.cli.check", "Check that a mechanism is consistent, for its author."),
    "mobility": ("pmopt.cli.mobility", "Freedoms and constraints from the declared joints."),
    "workspace": ("pmopt.cli.workspace", "Volume, dexterity and shape of a workspace."),
    "singularities": ("pmopt.cli.singularities", "Where singularities lie in the workspace."),
    "certify": ("pmopt.cli.certify", "Prove or refute dexterity at every pose of a box."),
    "motion": ("pmopt.cli.motion", "Joint motion, efforts and power along a trajectory."),
    "simulate": ("pmopt.cli.simulate", "The same motion on an independent engine."),
    "export": ("pmopt.cli.export", "A mechanism as a model of that engine (MuJoCo)."),
    "capability": (
        "pmopt.cli.capability",
        "Efforts and rates of a task; where given motors suffice.",
    ),
    "pareto": ("pmopt.cli.pareto", "Pareto front of volume and dexterity by NSGA-II."),
    "batch": ("pmopt.cli.batch", "Many runs on many cores or machines."),
    "plot": ("pmopt.cli.plot", "Draw the pictures of a finished run again."),
    "draw": ("pmopt.cli.draw", "Draw a mechanism at a pose."),
    "init": ("pmopt.cli.init", "Write a commented starting configuration."),
    "warmup": ("pmopt.cli.warmup", "Compile kernels ahead of use."),
    "completion": ("pmopt.cli.completion", "Print the script for shell completion."),
}


class LazyGroup(click.Group):
    """A group whose subcommands are imported when they are run."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(COMMANDS[cmd_name][0])
        command: click.Command = getattr(module, f"{cmd_name}_command")
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            if args[0] == "pmopt":
                raise InputError(f"pmopt is given twice: {shlex.join(['pmopt', *args[1:]])}")
            raise unknown_name("command", args[0], COMMANDS)
        return super().resolve_command(ctx, args)


@click.group(
    cls=LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, prog_name="pmopt")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Design of parallel mechanisms: workspace, dexterity and Pareto fronts with error bars.

    \b
    Example:
      pmopt workspace 2pauu-ppap --params m=1,n=0.7,l1=0.65,l2=1.5,c=0.1
    """
    if ctx.invoked_subcommand is None:
        click.echo(ctx.get_help())
