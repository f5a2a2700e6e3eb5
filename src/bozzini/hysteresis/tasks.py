"""The jobs of ``bozzini hysteresis``: laws fitted to loops, and what they predict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import MappingProxyType

from ..checks import quantity
from ..errors import InputError
from ..io.sheets import parse_columns
from ..progress import Progress, no_progress
from ..results import Shown
from ..task import Task
from .comparison import DRIFTS, LAWS, LoopComparison, compare_laws
from .files import LoopPrediction, predict_loops, read_law, write_law
from .record import LoopRuns, LoopTitles, read_loops


@dataclass(frozen=True, kw_only=True)
class LoopTable(Shown):
    """How a table of loops is read."""

    input: str | None = quantity(
        "text", "Title of the input, with or without its unit.", default=None, example="wheel"
    )
    output: str | None = quantity("text", "Title of the output.", default=None, example="probe")
    time: str | None = quantity(
        "text", "Title of the time (default: time, if there is one).", default=None,
        example="time [s]",
    )  # fmt: skip
    run_title: str | None = quantity(
        "text", "Title of labels of runs (default: run or window, if there is one).",
        default=None, option="run", example="run",
    )  # fmt: skip
    column: tuple[str, ...] = quantity(
        "text",
        "TITLE=OLD: a title to read in place of one in the file; can be repeated.",
        default=(),
        example="angle [deg]=col3",
    )

    def read(self, path: str, *, like: LoopTitles | None = None) -> LoopRuns:
        """Return the runs in a file; titles that are not given are those of `like`."""
        columns = parse_columns(self.column)
        titles = LoopTitles(
            input=self.input or "",
            output=self.output or "",
            time=self.time or "",
            run=self.run_title or "",
        )
        return read_loops(path, titles, columns=columns, like=like)


@dataclass(frozen=True, kw_only=True)
class LoopFitting(Task):
    """Fit laws with memory to measured loops of any input and output, side by side.

    TABLE has an input (a displacement, a pressure, a voltage ...), an output (an angle, counts
    ...), of any sign and unit, and perhaps a time and labels of runs. It is text (.csv, .tsv; also
    .gz), .xlsx, .parquet or .mat.

    The laws are a line, a cubic and a cubic of one backlash, the baselines; a backlash that widens
    with the tension (capstan), for which friction and compliance of the tendon are told as far as
    the units allow; a sum of plays (prandtl-ishlinskii), a cubic of one (generalised), and a cubic
    with a Bouc-Wen state. The start
    of each run is free: where the input turned last before it. The error of rows left out in five
    blocks in turn chooses the law, and gives the band; --hold-out keeps rows back to test both.

    The file of --out (.yaml, .json) has the law, for 'bozzini hysteresis predict'.

    Exit code 0: fitted; 1: the input never turns, or off by more than 10 % of the span; 2: bad
    input.
    """

    name = "fit"
    group = "hysteresis"
    result = LoopComparison
    formats = MappingProxyType({".yaml": write_law, ".yml": write_law, ".json": write_law})

    table: str = quantity("file", "A table of loops.")
    reading: LoopTable = LoopTable()
    law: str = quantity(
        "text", "The law for the file and the picture.", default="best", words=("best", *LAWS)
    )
    drift: str = quantity("text", "Drift beside all laws.", default="none", words=DRIFTS)
    hold_out: str = quantity(
        "text", "Last share of the rows, or labels of runs (A,B), not fitted.", default="0"
    )
    samples: int = quantity(
        help="Means of rows that are fitted, at most.", default=2000, low=50, high=20_000,
        whole=True,
    )  # fmt: skip

    def run(self, progress: Progress = no_progress) -> LoopComparison:
        """Return the comparison."""
        runs = self.reading.read(self.table)
        return compare_laws(
            runs,
            law=self.law,
            drift=self.drift,
            hold_out=_take_share(self.hold_out, runs.labels),
            samples=self.samples,
            progress=progress,
        )

    def describe(self, found: LoopComparison) -> str:
        """Return the table of laws, and what is known of the one chosen."""
        runs, parts, law = found.runs, found.parts, found.fit.law
        unit, known = (f" {word}" if word else "" for word in (runs.unit, runs.input_unit))
        counts = f"{len(runs)} rows in {len(runs.labels)} run(s), {parts.fitted.sum()} fitted"
        if found.kept < len(runs):
            counts += f" as {found.kept} means"
        counts += f", {parts.held_out.sum()} held out, {parts.lead.sum()} for starts alone"
        lines = [f"{counts}; rms of the output", found.format_table()]
        chosen = "best" if found.law == found.best else "chosen"
        covered = (
            ""
            if found.coverage != found.coverage
            else f", held by {100.0 * found.coverage:.1f} % of the rows held out"
        )
        lines.append(f"{chosen}: {found.law}; 95 % of rows within {found.band:.4g}{unit}{covered}")
        lines += [
            f"  {item.name} {item.value:.4g} ({item.low:.4g} to {item.high:.4g})"
            for item in found.constants
        ]
        if max(law.thresholds) > 0.0:
            turns = [f"{turn:.4g}" for turn in found.list_turns()]
            shown = ", ".join(turns[:5]) + (", ..." if len(turns) > 5 else "")
            lines.append(f"  before the runs the input turned at {shown}{known}")
        if found.drift != "none":
            lines.append(f"  {found.drift} drift of {found.drifted:.4g}{unit}")
        return "\n".join([*lines, *_tell(found.notes, found.reason)])


@dataclass(frozen=True, kw_only=True)
class LoopPredicting(Task):
    """Predict the output along the inputs of a table, by a law of 'bozzini hysteresis fit'.

    Where TABLE has an output, the first rows of each run settle its start, and the error is that of
    the others. With --resume the first run goes on where what was fitted ended.

    Exit code 0: done; 2: bad input.
    """

    name = "predict"
    group = "hysteresis"
    result = LoopPrediction

    fitted: str = quantity("file", "A file of 'bozzini hysteresis fit'.")
    table: str = quantity("file", "A table of inputs.")
    reading: LoopTable = LoopTable()
    resume: bool = quantity("flag", "Go on at the end of what was fitted.", default=False)

    def run(self, progress: Progress = no_progress) -> LoopPrediction:
        """Return the prediction."""
        file = read_law(self.fitted)
        like = LoopTitles(input=file.input, output=file.output)
        runs = self.reading.read(self.table, like=like)
        return predict_loops(file, runs, resume=self.resume)

    def describe(self, found: LoopPrediction) -> str:
        """Return the error, where outputs are known."""
        unit = f" {found.runs.unit}" if found.runs.unit else ""
        lines = [f"{len(found.runs)} rows in {len(found.runs.labels)} run(s), {found.file.law}"]
        if found.judged.any():
            lines.append(
                f"rms {found.error:.4g}{unit} over {found.judged.sum()} rows; the band of "
                f"{found.file.band:.4g}{unit} holds {100.0 * found.coverage:.1f} %"
            )
        return "\n".join([*lines, *_tell(found.notes, found.reason)])


def _take_share(text: str, labels: Sequence[str]) -> float | tuple[str, ...]:
    """Return labels of runs, or a share of rows; 0 is none, whatever the labels are."""
    names = tuple(part.strip() for part in text.split(",") if part.strip())
    if not names:
        raise InputError(f"hold out is '{text}': it must be a share or labels of runs")
    if text != "0" and set(names) <= set(labels):
        return names
    try:
        return float(text)
    except ValueError:
        return names


def _tell(notes: Sequence[str], reason: str) -> list[str]:
    return [*(f"note: {note}" for note in notes), *([reason] if reason else [])]
