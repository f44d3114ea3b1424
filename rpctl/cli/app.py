"""The command line ``rpctl``: its commands, each imported when it is called."""

from __future__ import annotations

import functools
import inspect
import operator
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from rpctl import __version__
from rpctl.cli.interrupts import exit_code, ignore_signals, raised_signals
from rpctl.cli.terminal import Streams, escape, say
from rpctl.errors import RpctlError

XACRO_OPTION = "--xacro-arg"
WORD = re.compile(r"(?:env:)?[A-Za-z_][\w.-]*:=")  # how a word begins that is one's value


@dataclass(frozen=True)
class LazyCommand:
    """A command before it is imported.

    Attributes:
        function: Where it is, ``module:function``. Typer makes options of its parameters, and of
            the fields of those that are dataclasses; its docstring is its help.
        summary: The first sentence of its help, for the list of commands.
        example: How it is called.
    """

    function: str
    summary: str
    example: str


COMMANDS = {
    "inspect": LazyCommand(
        "rpctl.cli.inspect:inspect_command",
        "Show a robot's drive, wheels and joints, and what is doubtful in its file.",
        "rpctl inspect tiago --lock 'head_*'",
    ),
    "verify": LazyCommand(
        "rpctl.cli.verify:verify_command",
        "Compare independent derivations of a robot's dynamics; exit 1 if they disagree.",
        "rpctl verify tiago --samples 200 --seed 7",
    ),
    "derive": LazyCommand(
        "rpctl.cli.export:derive_command",
        "Write the reduced equations of motion, or a control law, as text, LaTeX, Python or C.",
        "rpctl derive tiago --law unified --format c --out tiago_law.c",
    ),
    "export": LazyCommand(
        "rpctl.cli.export:export_command",
        "Write a robot as a MuJoCo model, once MuJoCo agrees with it, or a law as a ROS 2 package.",
        "rpctl export tiago --format mjcf --out tiago.xml, or "
        "rpctl export tiago --format ros2_control --law unified",
    ),
    "node": LazyCommand(
        "rpctl.cli.node:node_command",
        "Run a controller as a ROS 2 node, for prototypes, until Ctrl-C.",
        "rpctl node tiago --reference eight --output velocity",
    ),
    "check": LazyCommand(
        "rpctl.cli.export:check_command",
        "Verify an exported MuJoCo model and list its edits; exit 1 if one can change the motion.",
        "rpctl check tiago.xml",
    ),
    "track": LazyCommand(
        "rpctl.cli.track:track_command",
        "Simulate a robot that tracks a reference; write the run, a summary, plots and a report.",
        "rpctl track tiago --reference eight --initial-error 0.1,-0.1,0.1",
    ),
    "view": LazyCommand(
        "rpctl.cli.view:view_command",
        "Show a robot with sliders, or play runs, on a page served to this machine until Ctrl-C.",
        "rpctl view tiago, or rpctl view runs/tiago-eight",
    ),
    "plot": LazyCommand(
        "rpctl.cli.view:plot_command",
        "Write the figure of a run for a paper, as PDF or PNG.",
        "rpctl plot runs/tiago-eight --out tiago.pdf",
    ),
    "compare": LazyCommand(
        "rpctl.cli.compare:compare_command",
        "Compare pairs of laws over references and scenarios; write a table and a figure.",
        "rpctl compare tiago --references line,eight",
    ),
    "tune": LazyCommand(
        "rpctl.cli.tune:tune_command",
        "Compare bandwidths of the arm's joints: error, stiffness, effort, tolerated delay.",
        "rpctl tune tiago --bandwidth 4,8",
    ),
    "attraction": LazyCommand(
        "rpctl.cli.attraction:attraction_command",
        "Plot from which initial errors a law brings a robot to its reference, and how soon.",
        "rpctl attraction car --references line,circle --starts 100",
    ),
    "study": LazyCommand(
        "rpctl.cli.study:study_command",
        "Simulate a robot many times with varied settings; report outcomes and what causes them.",
        "rpctl study tiago --template > study.toml; rpctl study tiago study.toml --workers 4",
    ),
    "referee": LazyCommand(
        "rpctl.cli.referee:referee_command",
        "Drive a robot in other simulators and in the model, and explain where they disagree.",
        "rpctl referee tiago --html referee.html",
    ),
    "stress": LazyCommand(
        "rpctl.cli.stress:stress_command",
        "Find how much payload, delay, noise, slip and other stress laws bear before they fail.",
        "rpctl stress tiago --plants rolling --workers 4",
    ),
    "lag": LazyCommand(
        "rpctl.cli.tune:lag_command",
        "Identify lag and dead time of a robot that takes speeds, from a step in a log.",
        "rpctl lag step.csv",
    ),
    "expand": LazyCommand(
        "rpctl.cli.sources:expand_command",
        "Print the URDF that a .xacro expands to; line numbers in messages refer to it.",
        "rpctl expand robot.urdf.xacro > robot.urdf",
    ),
    "doctor": LazyCommand(
        "rpctl.cli.doctor:doctor_command",
        "Show versions, cache and extras, and what is missing; exit 1 if rpctl cannot run.",
        "rpctl doctor --json",
    ),
    "robots": LazyCommand(
        "rpctl.cli.sources:robots_command",
        "List the robots that can be loaded by name: rpctl's own, and those of other packages.",
        "rpctl robots --json",
    ),
}


WITHOUT_JSON = {"node": "it sends messages of ROS and prints ROS's log"}  # commands, and why


class LazyGroup(TyperGroup):
    """A group whose list of commands is known before the commands are imported."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        """Import the command that is called."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, load_command(name) if name else None, rest


class WordsCommand(TyperCommand):
    """A command that takes arguments of a .xacro as ROS users write them, wherever they stand."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Read the command line, words ``NAME:=VALUE`` as values of their option."""
        options = {name: each for each in self.params for name in each.opts}
        if XACRO_OPTION not in options:
            return super().parse_args(ctx, args)
        words: list[str] = []
        rest: list[str] = []
        valued = False  # whether the word before is an option that takes this one
        for arg in args:
            (words if not valued and WORD.match(arg) else rest).append(arg)
            option = options.get(arg)
            valued = not valued and option is not None and not getattr(option, "is_flag", True)
        return super().parse_args(ctx, [*(f"{XACRO_OPTION}={word}" for word in words), *rest])


app = typer.Typer(
    cls=LazyGroup,
    help="From any wheeled robot's URDF to a verified model, predictive control and an animation.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for name, command in COMMANDS.items():
    app.command(name, help=command.summary)(lambda: None)  # a row of the list of commands


def load_command(name: str) -> Any:
    """Import a command and return it with its options, as Typer's (and click's) ``Command``.

    Args:
        name: Of ``COMMANDS``.
    """
    command = COMMANDS[name]
    module, _, function = command.function.partition(":")
    single = typer.Typer(add_completion=False)
    single.command(name, cls=WordsCommand, epilog=f"Example: {command.example}")(
        _guarded(_flatten(getattr(import_module(module), function)))
    )
    return _arranged(typer.main.get_command(single))


def _arranged(command: Any) -> Any:
    """Return a command whose help shows its options in panels, those of the robot last.

    Their texts are no markup: ``[plant]`` is a table of TOML.
    """
    from rpctl.cli.options import PANELS  # it takes its time

    panels = {name: panel for panel, names in PANELS.items() for name in names}
    order = [*panels]
    for option in command.params:
        if isinstance(option, TyperOption):
            option.rich_help_panel = panels.get(str(option.name))
            option.help = escape(option.help or "")
    command.params.sort(key=lambda each: order.index(each.name) if each.name in panels else -1)
    return command


def _flatten(command: Callable[..., Any]) -> Callable[..., Any]:
    """Replace each parameter of a command that is a dataclass by the fields of the dataclass.

    Typer makes an option of each field; the command is called with the dataclass. What is
    annotated with ``FieldOptions`` is replaced by those, in turn.
    """
    flat, made = _options(command)

    @functools.wraps(command)
    def run(**given: Any) -> Any:
        return made(given)

    run.__signature__ = inspect.Signature(flat)  # type: ignore[attr-defined]
    return run


def _options(made: Callable[..., Any]) -> tuple[list[inspect.Parameter], Callable[..., Any]]:
    """Return the options of a command or dataclass, and what makes it of their values."""
    flat: list[inspect.Parameter] = []
    makers: dict[str, Callable[[dict[str, Any]], Any]] = {}
    for parameter in inspect.signature(made, eval_str=True).parameters.values():
        name, kind = parameter.name, parameter.annotation
        fields = next((m for m in getattr(kind, "__metadata__", ()) if hasattr(m, "flags")), None)
        if fields is not None:
            found, makers[name] = fields.parameters(), fields.given
        elif is_dataclass(kind) and isinstance(kind, type):
            found, makers[name] = _options(kind)
        else:
            found, makers[name] = [parameter], operator.itemgetter(name)
        flat += (each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in found)
    return flat, lambda given: made(**{name: make(given) for name, make in makers.items()})


def _guarded(command: Callable[..., Any]) -> Callable[..., Any]:
    """Turn an error that a user can mend into one message and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> Any:
        try:
            with raised_signals():
                return command(*args, **kwargs)
        except RpctlError as error:
            say(str(error), err=True)
            raise typer.Exit(error.exit_code) from None
        except MemoryError:
            say("out of memory; is the file or a cap (RPCTL_MAX_...) too large?", err=True)
            raise typer.Exit(RpctlError.exit_code) from None
        except KeyboardInterrupt as error:
            say(str(error) or "interrupted", err=True)
            raise typer.Exit(exit_code(error)) from None

    return run


def _version(wanted: bool) -> None:
    if wanted:
        say(f"rpctl {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line and leave with its exit code.

    A pipe whose reader has enough changes nothing; output that is lost is told, and is an error.
    """
    streams = Streams()
    code: object = 0
    try:
        app()
    except SystemExit as left:
        code = left.code
    ignore_signals()
    fault = streams.close()
    if fault is not None:
        say(f"standard output could not be written: {fault.strerror}", err=True)
        code = max(int(code or 0), RpctlError.exit_code) if isinstance(code, int) else code
    sys.exit(code)  # type: ignore[arg-type]
