"""The command ``bozzini``: finds the subcommand, and turns every outcome into an exit code.

Exit codes: 0 done; 1 an honest negative answer (for example: it does not fit); 2 bad input or
usage; 70 a fault in Bozzini itself; 130 interrupted; 141 the reader of the output went away. A
process that is terminated (SIGTERM, SIGHUP) removes what is unfinished, writes one line, then ends
by that signal.
"""

from __future__ import annotations

import difflib
import errno
import importlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

import click
from click.exceptions import Abort, Exit

from .. import __version__
from ..errors import BozziniError
from ..io.inputs import keep_inputs
from ..progress import announce_by
from .common import ARGUMENTS, EXIT_BAD_INPUT, EXIT_DONE, add_typed, write_json

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

__all__ = ["COMMANDS", "COMPLETE", "main", "root"]

JOBS = {
    "Plan a motion": {
        "demo": "Run the main job on a phantom tract: plan, report, 3-D scene.",
        "plan": "Plan a scope's motion through your own scan or surface.",
        "certify": "Check a saved plan, and prove its clearance again.",
        "reach": "Find how far scopes come into every branch of a tree.",
        "live": "Keep a scope clear in a tract that moves, frame by frame.",
        "cockpit": "See a motion and drive the tip, in the browser.",
        "execute": "Drive a motion with contact: forces, errors, loops.",
        "export": "Write a plan for simulators and robots: MJCF, URDF, ROS 2.",
        "show": "Show plans, tracts, shapes and robots in 3-D, on one page.",
        "record": "Film a plan: MP4 or GIF.",
    },
    "Tracts": {
        "segment": "Find the gas-filled lumen in a CT without labels.",
        "phantom": "Write a phantom upper gastro-intestinal tract to a file.",
        "data": "List and fetch public anatomy.",
        "duct": "Fit shapes to a tract, show them, find the longest link.",
        "tree": "List the branches of airways, vessels and other trees.",
    },
    "Robots and muscles": {
        "continuum": "Bend a tendon robot: pose, reach, compare models, workspace.",
        "effector": "Bend a catheter tip by pneumatic muscles: pose, reach, trace.",
        "head": "Look down on a catheter tip: a distal head's view and reach.",
        "muscle": "Solve a pneumatic muscle, compare models with data, fit them.",
        "hysteresis": "Fit laws with memory to loops of any input and output.",
        "rig": "Drive the pneumatic rig, emulated or on the bench.",
        "vision": "Measure lengths, shapes and points in pictures; calibrate.",
    },
    "Many runs": {
        "study": "Compute many rows from one file: sweeps, tolerances, maps.",
        "evaluate": "Rate policies that insert a scope, in many phantoms.",
        "uncertainty": "State how sure a plan or a study is, and what that comes of.",
    },
    "Files and help": {
        "new": "Write a file to start from: a plan, muscle, robot or study.",
        "schema": "Write the JSON Schema of a plan, muscle, robot or study.",
        "completion": "Write the script that completes commands in the shell.",
        "doctor": "Tell what is installed and found here, for a report of a fault.",
    },
}
"""Each command and its line in the help, by the job it belongs to; its code is
``bozzini.cli.<name>.command``."""

COMMANDS = {name: line for commands in JOBS.values() for name, line in commands.items()}

OTHER_NAMES = {
    "robot": "continuum",
    "tip": "effector",
    "new task": "new",
    "effector trace line": "effector trace",
    "effector trace circle": "effector trace",
    "effector study sweep": "effector sweep",
    "effector study least-pressure": "effector least-pressure",
    "muscle hysteresis fit": "muscle fit-loop",
    "muscle hysteresis trace": "muscle trace-loop",
    "muscle hysteresis invert": "muscle invert-loop",
}
"""Names that a newcomer tries, and names of before, each with that which answers to it."""

EXIT_INTERNAL_ERROR = 70
EXIT_INTERRUPTED = 130
EXIT_BROKEN_PIPE = 141

_NO_PLACE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EMFILE}
"""What an output may meet that is no fault of Bozzini: no space, for example."""

_NO_PATH = {errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP}
"""Why the system may refuse a path that was given."""

COMPLETE = "_BOZZINI_COMPLETE"
"""The variable by which a shell asks for completions."""


class LazyGroup(click.Group):
    """A group that imports a command only when that command runs or shows its help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of the table, then those of others."""
        return [*COMMANDS, *_list_tasks()]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the module of a command and return the command, or None if there is none."""
        if cmd_name not in COMMANDS:
            return _find_task(cmd_name)
        command: click.Command = importlib.import_module(f".{cmd_name}", __package__).command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command of the first word, which may be another name of it."""
        args = _take_other_names(args)
        name = args[0]
        if name in COMMANDS or name.startswith("-") or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        known = self.list_commands(ctx)
        if name not in known:
            others = [word for word in OTHER_NAMES if " " not in word]
            near = difflib.get_close_matches(name, [*known, *others], n=1)
            meant = f", did you mean '{near[0]}'?" if near else ""
            raise click.UsageError(f"there is no command '{name}'{meant}", ctx)
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Return commands and options that begin so, without importing any command."""
        from click.shell_completion import CompletionItem

        found = [
            CompletionItem(name, help=line)
            for name, line in {**COMMANDS, **_list_tasks()}.items()
            if name.startswith(incomplete)
        ]
        return found + click.Command.shell_complete(self, ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands without importing any of them."""
        listed = {name for commands in JOBS.values() for name in commands}
        others = {
            name: line for name, line in {**COMMANDS, **_list_tasks()}.items() if name not in listed
        }
        for job, commands in {**JOBS, "Others": others}.items():
            if commands:
                with formatter.section(job):
                    formatter.write_dl(list(commands.items()))
        for point in entry_points(group="bozzini.tasks"):
            if point.name in COMMANDS and not point.value.startswith("bozzini."):
                reason = f"left out, as a command of Bozzini is called '{point.name}'"
                formatter.write_text(f"The task of {point.value} is {reason}.")


def _take_other_names(words: list[str]) -> list[str]:
    """Return the words of a command by the names of today, the first name before the others."""
    for count in (1, 3, 2):
        name = " ".join(words[:count])
        if name in OTHER_NAMES and not (count == 1 and name in _list_tasks()):
            words = [*OTHER_NAMES[name].split(), *words[count:]]
    return words


def _list_tasks() -> dict[str, str]:
    """Return the tasks of other packages, each with a line that names its place."""
    points = entry_points(group="bozzini.tasks")
    return {p.name: f"A task of {p.value}." for p in points if p.name not in COMMANDS}


def _find_task(name: str) -> click.Command | None:
    """Return the command of a task of another package."""
    if name not in _list_tasks():
        return None
    from ..study.tasks import TASKS
    from .task import make_command

    return make_command(TASKS.choose(name))


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
    if COMPLETE in os.environ:
        return _complete()
    debug, given = _take_flag("--debug", given)
    as_json, _ = _take_flag("--json", given)
    run = _Run(as_json=as_json, debug=debug)
    _open_closed_streams()
    _allow_any_name()
    try:
        with _ending_cleanly():
            return run.invoke(given or ["--help"])
    except BrokenPipeError:
        _silence_stdout()
        return EXIT_BROKEN_PIPE
    except _Terminated as stop:
        with suppress(OSError):  # after SIGHUP there may be no terminal to write on
            run.report_interruption()
        signal.signal(stop.signal, signal.SIG_DFL)
        os.kill(os.getpid(), stop.signal)
        return 128 + stop.signal


def _show_note(text: str) -> None:
    from tqdm import tqdm

    tqdm.write(f"bozzini: note: {text}", file=sys.stderr)  # above a bar that is shown


class _Terminated(BaseException):
    """The process received a signal to end; what is unfinished is removed first."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.signal = number


@contextmanager
def _ending_cleanly() -> Iterator[None]:
    """Turn the signals that end a process into an exception while the block runs."""
    names = ("SIGTERM", "SIGHUP") if threading.current_thread() is threading.main_thread() else ()
    numbers = [getattr(signal, name) for name in names if hasattr(signal, name)]
    # A signal that is ignored (nohup) stays ignored.
    before = {number: signal.getsignal(number) for number in numbers}
    before = {number: old for number, old in before.items() if old == signal.SIG_DFL}
    report = sys.unraisablehook

    def stop(number: int, frame: object) -> None:
        raise _Terminated(number)

    def catch(lost: Any) -> None:
        # Python drops what is raised inside a callback of compiled code, such as a compiler's.
        if isinstance(lost.exc_value, (_Terminated, KeyboardInterrupt)):
            _lost.append(lost.exc_value)
            again = threading.Timer(0.05, _send_again, [lost.exc_value])
            again.daemon = True
            again.start()
        else:
            report(lost)

    for number in before:
        signal.signal(number, stop)
    sys.unraisablehook = catch
    try:
        yield
    finally:
        sys.unraisablehook = report
        _lost.clear()
        for number, old in before.items():
            signal.signal(number, old)


_lost: list[BaseException] = []
"""Interruptions that Python dropped, and that are not yet obeyed."""


def _send_again(stop: BaseException) -> None:
    if stop in _lost:
        os.kill(os.getpid(), stop.signal if isinstance(stop, _Terminated) else signal.SIGINT)


def _open_closed_streams() -> None:
    """Point a stdin, stdout or stderr that is closed (``>&-``) at nothing.

    Otherwise the next file that is opened gets its number, and what is printed.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # It gets the lowest number that is free, in processes of its own too.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
        if getattr(sys, name) is None:
            mode = "r" if number == 0 else "w"
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: SIM115  # to the end
            setattr(sys, name, stream)


def _allow_any_name() -> None:
    """Let stdout and stderr take names of files that are not of their encoding."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            # Bytes of a name that are not UTF-8 go out as they came in.
            whole = str(stream.encoding).lower().replace("-", "") == "utf8"
            stream.reconfigure(errors="surrogateescape" if whole else "backslashreplace")


class _Run:
    """One run of the command line: its arguments, and how it reports an error."""

    def __init__(self, *, as_json: bool, debug: bool) -> None:
        self.as_json = as_json
        self.debug = debug
        self.context: click.Context | None = None

    def invoke(self, arguments: list[str]) -> int:
        self._note_cache(arguments)
        quiet = not {"-q", "--quiet", "--json"}.isdisjoint(arguments)
        announce_by(None if quiet else _show_note)
        try:
            result = self._call(arguments)
            sys.stdout.flush()
        except Exit as stop:
            sys.stdout.flush()
            return int(stop.exit_code)
        except click.ClickException as error:
            return self._report_usage(error)
        except BozziniError as error:
            message = add_typed(str(error), self.context)
            return self._report(type(error).__name__, message, EXIT_BAD_INPUT)
        except (KeyboardInterrupt, Abort):
            return self.report_interruption()
        except BrokenPipeError:
            raise
        except OSError as error:
            if error.errno in _NO_PATH and error.filename is not None:
                message = f"{os.fsdecode(error.filename)}: {error.strerror}"
                return self._report("InputError", message, EXIT_BAD_INPUT)
            if error.errno not in _NO_PLACE:
                return self._report_internal(error)
            _silence_stdout()
            where = f"cannot write {error.filename}" if error.filename else "cannot write"
            return self._report("OutputError", f"{where}: {error.strerror}", EXIT_BAD_INPUT)
        except MemoryError:
            message = "not enough memory: a larger --voxel or --cell needs less"
            return self._report("MemoryError", message, EXIT_BAD_INPUT)
        except Exception as error:
            return self._report_internal(error)
        return result if isinstance(result, int) else EXIT_DONE

    def _call(self, arguments: list[str]) -> Any:
        try:
            self.context = root.make_context("bozzini", list(arguments))
            self.context.meta[ARGUMENTS] = arguments[1:]
            with self.context, keep_inputs():
                return root.invoke(self.context)
        except Exception:
            if _lost:  # not an error, but what an interruption left behind
                raise _lost.pop() from None
            raise

    def report_interruption(self) -> int:
        """Report that the run was interrupted, and return the exit code of that."""
        return self._report("Interrupted", "interrupted", EXIT_INTERRUPTED)

    def _note_cache(self, arguments: list[str]) -> None:
        from ..io.files import find_compiled_code, find_provided_cache

        cache = find_provided_cache()
        works = arguments[0] in COMMANDS and not {"-h", "--help"} & set(arguments)
        wanted = os.environ.get("NUMBA_CACHE_DIR")
        if works and wanted and cache is None and (place := find_compiled_code()) != wanted:
            click.echo(
                f"bozzini: note: NUMBA_CACHE_DIR={wanted} cannot be written: compiled code is kept "
                f"in {place}",
                err=True,
            )
        if cache is not None and works:
            click.echo(
                f"bozzini: note: compiled code is kept in {cache}, as neither the installation nor "
                "the home directory can be written; NUMBA_CACHE_DIR names another place",
                err=True,
            )

    def _report_usage(self, error: click.ClickException) -> int:
        context = error.ctx if isinstance(error, click.UsageError) else None
        if type(error).__name__ == "NoArgsIsHelpError" and context and not self.as_json:
            click.echo(context.get_help())
            return EXIT_DONE
        message = _join_lines(error.format_message()).rstrip(".")
        if type(error).__name__ == "NoArgsIsHelpError":
            message = "no command given"
        if context is not None:
            message += f" (try '{context.command_path} --help')"
        return self._report("UsageError", message, EXIT_BAD_INPUT)

    def _report_internal(self, error: Exception) -> int:
        if isinstance(error, RuntimeError) and "cannot cache function" in str(error):
            message = "no directory for compiled code: set NUMBA_CACHE_DIR to one to write to"
            return self._report("OutputError", message, EXIT_BAD_INPUT)
        message = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        if not self.debug:
            message += "; run with --debug for the traceback"
        return self._report("InternalError", message, EXIT_INTERNAL_ERROR)

    def _report(self, kind: str, message: str, code: int) -> int:
        """Write one line on stderr, and in JSON mode the one object on stdout."""
        if self.debug and sys.exc_info()[0] is not None:
            traceback.print_exc(file=sys.stderr)
        line = _join_lines(message)
        prefix = "internal error: " if code == EXIT_INTERNAL_ERROR else "error: "
        click.echo(f"bozzini: {'' if code == EXIT_INTERRUPTED else prefix}{line}", err=True)
        if self.as_json and not (self.context and self.context.meta.get("bozzini.emitted")):
            try:
                write_json({"error": {"type": kind, "message": line}})
                sys.stdout.flush()
            except OSError as error:  # what was wrong stands on stderr
                click.echo(f"bozzini: error: cannot write: {error.strerror}", err=True)
                return EXIT_BAD_INPUT
        return code


def _take_flag(flag: str, arguments: list[str]) -> tuple[bool, list[str]]:
    """Return whether `flag` stands before any ``--``, and return the arguments without it."""
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

    return shell_complete(root, {}, "bozzini", COMPLETE, os.environ[COMPLETE])


if __name__ == "__main__":
    sys.exit(main())
