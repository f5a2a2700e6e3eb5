"""``bozzini rig``: the pneumatic rig, emulated or on the bench."""

from __future__ import annotations

import dataclasses
import json
import shlex
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..checks import check_number
from ..effector.design import DEFAULT_PRESET
from ..errors import InputError
from ..results import format_rows
from ..rig.choices import CONTROLLERS
from ..rig.protocol import SETPOINT_MAX
from ..rig.stairs import Stairs
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    OUTPUT,
    PICTURES,
    Answer,
    CheckedGroup,
    QuantityType,
    answer_options,
    check_target,
    clean_json,
    format_csv,
    option,
    options_of,
    refuse_options,
    run_exit,
)
from .effector import effector_argument
from .muscle_options import CHOICES, FIELDS, Request, one_model_options
from .rig_camera import CameraRequest, camera_options, characterise_by_camera

if TYPE_CHECKING:
    from ..effector import Effector
    from ..results import Result
    from ..rig import CircleRun, Cosimulation, FaultResponses, HostRun, Link, Replay, StepResponses
    from ..rig.emulate import BoardKind
    from ..rig.identify import CurveFit, Identification

BOARDS = ("emulated", "native")

port_option = option("--port PORT", "A board on the bench, such as /dev/ttyACM0.")
board_option = option(
    "--board",
    "Of an emulated rig: its chip cycle by cycle, or its code compiled for this computer.",
    BOARDS,
    default="emulated",
)
seed_option = click.option("--seed", default=0, show_default=True, help="Of the sensors' noise.")
duration_option = option("--duration TIME", "How long.", "time", default="10s")
period_option = option("--period TIME", "Of the host's loop.", "time", default="10ms")


@click.group("rig", cls=CheckedGroup)
def command() -> None:
    """Drive the pneumatic rig: an emulated one, or a board on the bench."""


def _make_effector(preset: str) -> Effector:
    from ..rig import open_rig_effector

    return open_rig_effector(preset)


@contextmanager
def _open_link(
    port: str | None, effector: Effector, board: BoardKind = "emulated", seed: int = 0
) -> Iterator[Link]:
    """Give the link to a board at a port, or to an emulated rig in lock-step."""
    from ..rig import LockstepLink, SerialLink, emulate_rig

    if port is not None:
        link: Link = SerialLink(port)
    else:
        rig = emulate_rig(effector.models, board=board, seed=seed, motion=effector.motion)
        link = LockstepLink(rig)
    try:
        yield link
    finally:
        link.close()


def _show_table(result: Result) -> str:
    """Return the table of a result for people."""
    table = result.list_table()
    rows = [[_show_cell(cell) for cell in row] for row in zip(*table.values(), strict=True)]
    return format_rows(list(table), rows)


def _show_cell(cell: object) -> str:
    if isinstance(cell, float):
        return "-" if cell != cell else f"{cell:.1f}"
    return {"True": "yes", "False": "NO"}.get(str(cell), str(cell))


def _end(result: Result) -> None:
    if not result.converged:
        click.echo(f"note: {result.reason}", err=True)
        run_exit(EXIT_NEGATIVE)


@command.command("demo")
@board_option
@seed_option
@answer_options(
    default="bozzini-rig-demo",
    show_default=True,
    metavar="DIRECTORY",
    help="Directory for the figures and the tables.",
)
def demo_command(board: BoardKind, seed: int, answer: Answer) -> None:
    """Show steps, a stick that goes in circles, and faults, on an emulated rig."""
    from ..io.files import new_directory, write_text
    from ..io.sheets import write_table
    from ..plot import write_figure
    from ..rig import HostRun, emulate_rig, run_circle, run_faults, run_steps

    effector = _make_effector(DEFAULT_PRESET)

    def make_rig() -> Cosimulation:
        return emulate_rig(effector.models, board=board, seed=seed)

    with new_directory(answer.target, force=answer.force) as folder:
        with answer.show_progress() as progress:
            found: dict[str, StepResponses | CircleRun | FaultResponses] = {
                "steps": run_steps(make_rig(), progress=progress),
                "circle": run_circle(make_rig(), effector, progress=progress),
                "faults": run_faults(make_rig, progress=progress),
            }
        for name, result in found.items():
            write_figure(result.plot(), folder / f"{name}.png")
            write_table(folder / f"{name}.csv", result.list_table())
        plain = {name: clean_json(result) for name, result in found.items()}
        files = sorted([*(file.name for file in folder.iterdir()), "summary.json"])
        summary = {"files": files, "board": board, "seed": seed, **plain}
        write_text(folder / "summary.json", f"{json.dumps(summary, indent=2)}\n")
    shown = {
        name: _describe_circle(result) if isinstance(result, HostRun) else _show_table(result)
        for name, result in found.items()
    }
    text = "\n\n".join(f"{name}\n{words}" for name, words in shown.items())
    answer.give({"output": answer.target, **plain}, f"{text}\n\n{answer.target}")


@command.command("run")
@port_option
@board_option
@seed_option
@effector_argument
@option(
    "--stick",
    "Where the stick is: on the board, a gamepad, or a script that goes in circles.",
    ("board", "gamepad", "circle"),
    default="circle",
)
@option("--frequency FREQUENCY", "Of the circles.", "frequency", default="0.5Hz")
@option(
    "--controller",
    "What makes set-points of the tip's place: the static inverse; the same with valves opened by "
    "a model of the plant, of the constants that the emulated rig has; or predictive control.",
    CONTROLLERS,
    default=CONTROLLERS[0],
)
@duration_option
@period_option
@answer_options(".parquet", ".csv", *PICTURES, help="The log (.parquet, .csv), or a picture.")
def run_command(
    port: str | None,
    board: BoardKind,
    seed: int,
    effector: str,
    stick: str,
    frequency: float,
    controller: str,
    duration: float,
    period: float,
    answer: Answer,
) -> None:
    """Steer the tip by a stick: stick, inverse kinematics, pressures, forward kinematics.

    The predictive controller looks ahead in a model of the section in time, at 50 Hz, within the
    board's limits of pressure and rate.

    Without --port the rig is an emulated one in lock-step: the same numbers every time.
    """
    from ..rig import Host, Steering, make_controller, make_stick

    steered = _make_effector(effector)
    source = make_stick(stick, frequency=frequency, duration=duration)
    with _open_link(port, steered, board, seed) as link, answer.show_progress() as progress:
        host = Host(link, period=period)
        made = make_controller(controller, steered, board=host.connect(), period=period)
        steering = Steering(steered, source, controller=made)
        run = host.run(steering, duration, progress=progress)
    _write_log(run, answer)
    answer.give(run, _describe_run(run))
    _end(run)


@command.command("replay")
@click.argument("log", type=INPUT)
@port_option
@board_option
@seed_option
@effector_argument
@answer_options(".parquet", ".csv", *PICTURES, help="The new log (.parquet, .csv), or a picture.")
def replay_command(
    log: Path, port: str | None, board: BoardKind, seed: int, effector: str, answer: Answer
) -> None:
    """Send the set-points of a LOG again, and compare the pressures."""
    from ..rig import load_log, replay_log

    table = load_log(log)
    with _open_link(port, _make_effector(effector), board, seed) as link:
        with answer.show_progress() as progress:
            replay = replay_log(link, table, progress=progress)
    _write_log(replay, answer)
    answer.give(
        replay,
        f"{len(replay.run.rows)} periods; pressures differ by {1e3 * replay.rms:.1f} kPa rms, "
        f"{1e3 * replay.residual:.1f} kPa at most",
    )
    _end(replay)


@command.command("emulate")
@board_option
@seed_option
@effector_argument
@option("--duration TIME", "How long; by default it runs on.", "time")
def emulate_command(board: BoardKind, seed: int, effector: str, duration: float | None) -> None:
    """Run an emulated rig in real time; print the port that a host can open."""
    import threading

    from ..rig import emulate_rig, serve

    moved = _make_effector(effector)
    rig = emulate_rig(moved.models, board=board, seed=seed, motion=moved.motion)
    rig.run(0.01)  # what is compiled on first use is compiled now
    stop = threading.Event()
    if duration is not None:
        span = check_number("duration", duration, low=0.0, low_open=True, high=86400.0, unit="s")
        timer = threading.Timer(span, stop.set)
        timer.daemon = True
        timer.start()
    serve(rig, lambda path: click.echo(path), stop=stop)


@command.command("selftest")
@port_option
@board_option
@answer_options(".csv", help="The table.")
def selftest_command(port: str | None, board: BoardKind, answer: Answer) -> None:
    """Check a board: firmware, refusals, silence of the host, evenness of time.

    Without --port an emulated rig behind a pseudo-terminal is checked, in real time.
    """
    from ..io.files import write_text
    from ..rig import SerialLink, check_board, emulated_port

    @contextmanager
    def open_port() -> Iterator[str]:
        if port is not None:
            yield port
        else:
            with emulated_port("--board", board) as path:
                yield path

    with open_port() as path, answer.show_progress() as progress:
        link = SerialLink(path)
        try:
            found = check_board(link, progress=progress)
        finally:
            link.close()
    if answer.out is not None:
        write_text(answer.out, format_csv(found.list_columns()))
    answer.give(found, _show_table(found))
    _end(found)


@command.command("characterise")
@port_option
@board_option
@seed_option
@one_model_options
@option(
    "--reading-error LENGTH",
    "Standard deviation of a reading of the plant's contraction.",
    "length",
    default="0.05mm",
)
@options_of(Stairs, "stairs")
@camera_options
@option(
    "--play",
    "Half width of the backlash between pressure and contraction of the emulated muscle.",
    "pressure",
    default="0kPa",
)
@option("--hook PROGRAM", "Takes a picture at each step, see above.")
@option("--hook-timeout TIME", "Longest time a picture may take.", "time", default="10s")
@option("--figure plot FILE", "A picture of the curve.", OUTPUT)
@answer_options(".csv", ".parquet", required=True, help="The table (.csv, .parquet).")
def characterise_command(
    port: str | None,
    board: BoardKind,
    seed: int,
    asked: Request,
    reading_error: float,
    stairs: Stairs,
    seen: CameraRequest,
    play: float,
    hook: str | None,
    hook_timeout: float,
    plot: Path | None,
    answer: Answer,
) -> None:
    """Move a muscle's pressure up and down in stairs, and measure it at each step.

    Without --port the rig is an emulated one with the muscle and model that the options describe,
    and its contraction is read there. The table is what 'bozzini muscle fit' takes. Steps that do
    not settle are flagged in it.

    PROGRAM is run at the end of each step, without a shell, such as --hook 'camera --to {file}'.
    {file} is the picture to write, {pressure} the set-point in MPa, {direction} inflating or
    deflating, {repeat} the number of the repeat. The pictures go to a directory beside the table,
    with a manifest.csv for 'bozzini vision length'. If PROGRAM fails, the step is flagged.

    With --camera it goes to the end: it measures the lengths in the pictures, fits the model (its
    tube's modulus, its braid's angle and an offset), and writes a report with contraction,
    hysteresis and stiffness, a file of the fit and the lengths beside the table. 'rendered' draws
    the pictures from the emulated muscle as it truly is; the fit starts from a typical tube and
    braid. With a real camera the options of the muscle are where the fit starts.

    When it is interrupted it vents and writes what was measured.

    Exit code 0: all steps settled; 1: some are flagged, the board left its armed state, or what is
    fitted with --camera is in doubt; 2: bad input.
    """
    from ..effector.motion import EffectorMotion
    from ..rig import Host, LockstepLink, SerialLink, emulate_rig
    from ..rig.characterise import (
        Characterisation,
        Gauge,
        PictureHook,
        PlantGauge,
        characterise_muscle,
    )
    from ..rig.plant import Chamber

    table = answer.target
    check_target(plot, PICTURES, force=answer.force)
    seen.check(port=port, hook=hook)
    if port is not None:
        plant = ("board", "seed", "reading_error", "play")
        refuse_options(plant, "with --port")
        if seen.camera is None:
            refuse_options(("muscle_file", "settings", *CHOICES, *FIELDS), "with --port")
    check_number("play", play, low=0.0, high=SETPOINT_MAX, unit="MPa")

    @contextmanager
    def open_host(weight: float) -> Iterator[tuple[Host, Gauge | None]]:
        gauge: Gauge | None = None
        if port is not None:
            link: Link = SerialLink(port)
        else:
            chamber = Chamber.from_model(asked.build(pressure=stairs.highest), weight)
            motion = EffectorMotion(play_radii=(play,), play_weights=(1.0,)) if play > 0.0 else None
            rig = emulate_rig(chamber, board=board, seed=seed, motion=motion)
            link = LockstepLink(rig)
            error = 0.0 if seen.camera is not None else reading_error
            gauge = PlantGauge(rig.plant, stairs.muscle, deviation=error, seed=seed)
        try:
            host = Host(link)
            host.connect()
            yield host, gauge
        finally:
            link.close()

    if seen.camera is not None:
        refuse_options(("reading_error",), "with --camera")
        if plot is not None:
            raise InputError("--figure has no effect with --camera: the report has the pictures")
        characterise_by_camera(seen, open_host, stairs, asked=asked, answer=answer, seed=seed)
        return
    camera = None
    if hook is not None:
        pictures = table.with_name(f"{table.stem}-pictures")
        camera = PictureHook(command=hook, folder=pictures, timeout=hook_timeout)
    elif port is not None:
        raise InputError("--port needs --hook or --camera: nothing else measures the length")

    def save(found: Characterisation) -> None:
        found.save(table)
        if any(row.image for row in found.rows) and camera is not None:
            found.save_pictures(camera.folder / "manifest.csv")

    with open_host(stairs.load) as (host, gauge), answer.show_progress() as progress:
        found = characterise_muscle(
            host, stairs, gauge=gauge, camera=camera, keep=save, progress=progress
        )
    save(found)
    if plot is not None:
        dataclasses.replace(answer, out=plot).draw(found.plot)
    result = {**found.to_dict(), "file": table, "pictures": camera and camera.folder}
    answer.give(
        result,
        f"{table}: {len(found.rows)} steps, {found.flagged} flagged; pressure off its set-point by "
        f"{1e3 * found.residual:.1f} kPa at most",
    )
    _end(found)


@command.command("identify")
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=INPUT)
@click.option(
    "--check",
    "checked",
    multiple=True,
    type=INPUT,
    metavar="FILE",
    help="A curve to check: the rest of it is predicted from its beginning; can be repeated.",
)
@click.option(
    "--share",
    type=float,
    help="Share of the change up to which a checked curve is used, 0.3 to 0.89 (default: 0.8).",
)
@click.option(
    "--unit",
    help="Unit of pressures in files that state none, such as kPa, or count (default: count for "
    "whole numbers, otherwise kPa).",
)
@click.option(
    "--supply",
    type=QuantityType("pressure"),
    help="Gauge pressure that the highest count stands for.",
    default="0.62MPa",
    show_default=True,
)
@answer_options(".csv", *PICTURES, quiet=False, help="A table (.csv) or a picture.")
def identify_command(
    files: tuple[Path, ...],
    checked: tuple[Path, ...],
    share: float | None,
    unit: str | None,
    supply: float,
    answer: Answer,
) -> None:
    """Find the law by which muscles fill, or leak, and its constants.

    FILE is a .mat file with a matrix 'data', or a .csv file; its columns are time, (valve,)
    pressure. Curves that rise are fills, others leaks. The laws of a fill are an orifice, one
    behind a regulator or a line that resists, the same with the transducer before the orifice, and
    the second with a volume that grows; of a leak an orifice or a narrow gap.

    Exit code 0: a law describes each curve within 3 % of its change; 1: not; 2: bad input.
    """
    from ..rig.curves import read_curve
    from ..rig.identify import CHECK_SHARE, find_kind, identify_fill, identify_leak

    if share is not None and not checked:
        raise InputError("--share has no effect without --check: leave it out")
    curves = [read_curve(path, unit=unit, supply=supply) for path in files]
    others = [read_curve(path, unit=unit, supply=supply) for path in checked]
    kinds = {
        path: find_kind(c) for path, c in zip((*files, *checked), curves + others, strict=True)
    }
    kind = kinds[files[0]]
    for path, other in kinds.items():
        if other != kind:
            raise InputError(f"{path} is a {other}, {files[0]} a {kind}: give files of one kind")
    found = (identify_fill if kind == "fill" else identify_leak)(curves)
    if others:
        found = found.check(others, share=CHECK_SHARE if share is None else share)
    answer.write(found.list_columns(), found.plot)
    result = {
        "kind": found.kind,
        "converged": found.converged,
        "reason": found.reason,
        "residual_MPa": found.residual,
        "worst_time_error": found.worst_time_error,
        "fits": [_describe_fit(fit) for fit in found.fits],
        "checks": [_describe_fit(fit) for fit in found.checks],
        "notes": found.notes,
        "file": answer.out,
    }
    answer.give(result, _format_fits(found))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _describe_fit(fit: CurveFit) -> dict[str, object]:
    return {
        **fit.list_row(),
        "standard_errors": fit.standard_errors,
        "undetermined": fit.undetermined,
    }


def _format_fits(found: Identification) -> str:
    head = ["curve", "law", "residual [kPa]", "t90 measured [s]", "by the law [s]", "error"]
    head += ["time constant [s]"]
    rows = [
        [
            fit.curve.name + (f" (check, to {100 * fit.used:g} %)" if fit.used < 1.0 else ""),
            fit.law,
            f"{1e3 * fit.residual:.1f}",
            f"{fit.measured_time:.4g}",
            f"{fit.model_time:.4g}",
            f"{100 * fit.time_error:+.1f} %",
            f"{fit.constants['time constant']:.4g}",
        ]
        for fit in (*found.fits, *found.checks)
    ]
    lines = [f"{found.kind}: t90 is the time from 5 to 90 % of the change", format_rows(head, rows)]
    lines += [
        f"{fit.curve.name}: not determined: {', '.join(fit.undetermined)}"
        for fit in found.fits
        if fit.undetermined
    ]
    lines += [f"note: {note}" for note in found.notes]
    lines += [f"warning: {text}" for text in found.reason.split("; ") if text]
    return "\n".join(lines)


@command.command("flash")
@option("--port PORT", "Of the board, such as /dev/ttyACM0.", required=True)
@option(
    "--programmer NAME",
    "Of avrdude: wiring for the boot loader of an Arduino Mega; usbasp, avrispmkii and others for "
    "ISP, which keeps the latched fault after a watchdog reset.",
    default="wiring",
)
@option("--run run", "Run the command, instead of showing it.", is_flag=True)
@answer_options(quiet=False)
def flash_command(port: str, programmer: str, run: bool, answer: Answer) -> None:
    """Build the firmware and show the command that writes it to a board; --run runs it."""
    from ..rig.firmware import build

    for name, word in (("port", port), ("programmer", programmer)):
        if not word.strip():
            raise InputError(f"{name} is {word!r}: it must not be empty")
    words = f"avrdude -p atmega2560 -c {shlex.quote(programmer)} -P {shlex.quote(port)}"
    words += " -b 115200 -D" if programmer == "wiring" else ""
    line = f"{words} -U flash:w:{shlex.quote(str(build('firmware.hex')))}:i"
    answer.give({"command": line, "run": run}, line)
    if not run:
        return
    try:
        code = subprocess.run(shlex.split(line)).returncode
    except FileNotFoundError:
        raise InputError("avrdude is not installed; on Debian: apt-get install avrdude") from None
    if code:
        run_exit(EXIT_NEGATIVE)


def _write_log(run: HostRun | Replay, answer: Answer) -> None:
    """Write a log, as a table or as a picture."""
    if answer.out is None:
        return
    if answer.out.suffix.lower() in (".parquet", ".csv"):
        run.save(answer.out)
    else:
        answer.draw(run.plot)


def _describe_run(run: HostRun) -> str:
    jitter = ", ".join(f"{name[:-3]} {value:.2f}" for name, value in run.jitter.items())
    return (
        f"{len(run.rows)} periods: {jitter} ms; late {run.late}, lost {run.lost}, damaged "
        f"{run.bad + run.refused}\n{_describe_circle(run)}"
    )


def _describe_circle(run: HostRun) -> str:
    """Return how far the tip was from where it was wanted."""
    return (
        f"tip from its target: {run.tip_error_rms:.2f} mm rms, {run.tip_error_max:.2f} mm at most"
        if run.tip_errors.size
        else "no target of the tip in this run"
    )
