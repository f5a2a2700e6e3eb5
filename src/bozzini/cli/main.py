"""The command ``bozzini``: finds the subcommand, and turns every outcome into an exit code.

Exit codes: 0 done; 1 an honest negative answer (for example: it does not fit); 2 bad input or
usage; 70 a fault in Bozzini itself; 130 interrupted; 141 the reader of the output went away.
"""

from __future__ import annotations

import importlib
import os
import sys
import traceback
from collections.abc import Sequence

import click
from click.exceptions import Abort, Exit

from .. import __version__
from ..errors import BozziniError
from .common import EXIT_BAD_INPUT, EXIT_DONE, write_json

__all__ = ["COMMANDS", "main", "root"]

COMMANDS = {
    "demo": "Run the whole way on a phantom tract: plan, report, 3-D scene.",
    "plan": "Plan a scope's motion through your own scan or surface.",
    "certify": "Check a saved plan, and prove its clearance anew.",
    "phantom": "Write a phantom upper gastro-intestinal tract to a file.",
    "segment": "Find the gas-filled lumen in a CT without labels.",
    "data": "List and fetch public anatomy.",
    "duct": "Fit shapes to a tract, show them, find the longest link.",
    "muscle": "Solve a pneumatic muscle, compare models with data, fit them.",
    "continuum": "Bend a tendon robot: pose, reach, compare models, workspace.",
    "effector": "Bend a catheter tip by pneumatic muscles: pose, reach, trace.",
}
"""Each command and its line in the help; its code is ``bozzini.cli.<name>.command``."""

EXIT_INTERNAL_ERROR = 70
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

_COMPLETE = "_BOZZINI_COMPLETE"


class LazyGroup(click.Group):
    """A group that imports a command only when that command runs or shows its help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of a command and return the command, or None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(f".{cmd_name}", __package__).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands without importing any of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Every command takes --json (one object on stdout) and --help. "
    "Exit code: 0 done, 1 a negative answer, 2 bad input.",
)
@click.version_option(__version__, prog_name="bozzini", message="%(prog)s %(version)s")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def root(debug: bool) -> None:
    """Open tools for endoscopic robots: from a CT scan to a scope's motion."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        The arguments after the program's name; None means those of this process.

    Returns
    -------
    int
        The exit code. No exception leaves this function.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if _COMPLETE in os.environ:
        return _complete()
    debug, given = _take_flag("--debug", given)
    as_json, _ = _take_flag("--json", given)
    run = _Run(as_json=as_json, debug=debug)
    try:
        return run.invoke(given or ["--help"])
    except BrokenPipeError:
        _silence_stdout()
        return EXIT_BROKEN_PIPE


class _Run:
    """One run of the command line: what was asked for, and how an error is told."""

    def __init__(self, *, as_json: bool, debug: bool) -> None:
        self.as_json = as_json
        self.debug = debug
        self.context: click.Context | None = None

    def invoke(self, arguments: list[str]) -> int:
        try:
            self.context = root.make_context("bozzini", arguments)
            with self.context:
                result = root.invoke(self.context)
            sys.stdout.flush()
        except Exit as stop:
            sys.stdout.flush()
            return int(stop.exit_code)
        except click.ClickException as error:
            return self._tell_usage(error)
        except BozziniError as error:
            return self._tell(type(error).__name__, str(error), EXIT_BAD_INPUT)
        except (KeyboardInterrupt, Abort):
            return self._tell("Interrupted", "interrupted", EXIT_INTERRUPTED)
        except BrokenPipeError:
            raise
        except MemoryError:
            message = "not enough memory: ask for less (a larger --voxel or --cell)"
            return self._tell("MemoryError", message, EXIT_BAD_INPUT)
        except Exception as error:
            return self._tell_internal(error)
        return result if isinstance(result, int) else EXIT_DONE

    def _tell_usage(self, error: click.ClickException) -> int:
        context = error.ctx if isinstance(error, click.UsageError) else None
        if type(error).__name__ == "NoArgsIsHelpError" and context and not self.as_json:
            click.echo(context.get_help())
            return EXIT_DONE
        message = _join_lines(error.format_message()).rstrip(".")
        if type(error).__name__ == "NoArgsIsHelpError":
            message = "no command given"
        if context is not None:
            message += f" (try '{context.command_path} --help')"
        return self._tell("UsageError", message, EXIT_BAD_INPUT)

    def _tell_internal(self, error: Exception) -> int:
        message = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        if not self.debug:
            message += "; run with --debug for the traceback"
        return self._tell("InternalError", message, EXIT_INTERNAL_ERROR)

    def _tell(self, kind: str, message: str, code: int) -> int:
        """Write one line on stderr, and in JSON mode the one object on stdout."""
        if self.debug and sys.exc_info()[0] is not None:
            traceback.print_exc(file=sys.stderr)
        line = _join_lines(message)
        prefix = "internal error: " if code == EXIT_INTERNAL_ERROR else "error: "
        click.echo(f"bozzini: {'' if code == EXIT_INTERRUPTED else prefix}{line}", err=True)
        if self.as_json and not (self.context and self.context.meta.get("bozzini.emitted")):
            write_json({"error": {"type": kind, "message": line}})
            sys.stdout.flush()
        return code


def _take_flag(flag: str, arguments: list[str]) -> tuple[bool, list[str]]:
    """Say whether `flag` stands before any ``--``, and return the arguments without it."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    before = [item for item in arguments[:end] if item != flag]
    return len(before) < end, before + arguments[end:]


def _join_lines(text: str) -> str:
    return " ".join(text.split())


def _silence_stdout() -> None:
    """Point stdout at nothing, so that the interpreter's last flush does not fail again."""
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
    except (OSError, ValueError):
        pass


def _complete() -> int:
    from click.shell_completion import shell_complete

    return shell_complete(root, {}, "bozzini", _COMPLETE, os.environ[_COMPLETE])


if __name__ == "__main__":
    sys.exit(main())
