"""Files of fitted laws, and what these predict of other tables."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_path, choose
from ..errors import FileFormatError, InputError
from ..io.files import write_text
from ..io.records import format_yaml, load_data, read_record, write_record
from ..io.sheets import split_title
from ..muscle.hysteresis.operator import number, take_fields
from ..numeric.arrays import Floats
from ..results import Json, ReasonedResult, Shown, take_axes, to_plain
from .comparison import LAWS, LoopComparison, count_lead
from .fitting import Fitted, Mask, Samples, settle_starts
from .law import LoopLaw, LoopState
from .record import LoopRuns, check_units

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KIND = "loops"
VERSION = 1


@dataclass(frozen=True, kw_only=True)
class LoopFile(Shown):
    """A fitted law with what is known of it.

    Parameters
    ----------
    kind, version : str, int
        What the file is.
    law : str
        Its name.
    input, output : str
        Titles of the columns.
    lowest, highest : float
        Inputs that were fitted.
    band : float
        Half of the band that holds 95 % of rows left out [output].
    offset : float
        The drift at the end of the record [output], which goes on.
    constants : LoopLaw
    state : LoopState
        At the end of the record.
    """

    kind: str = KIND
    version: int = VERSION
    law: str
    input: str
    output: str
    lowest: float = number()
    highest: float = number()
    band: float = number(0.0)
    offset: float = number(default=0.0)
    constants: LoopLaw
    state: LoopState

    def __post_init__(self) -> None:
        take_fields(self)
        if self.kind != KIND or self.version != VERSION:
            raise InputError(f"it has no 'kind: {KIND}' of version {VERSION}")
        choose("law", self.law, dict.fromkeys(LAWS))
        if len(self.state.plays) != len(self.constants.thresholds):
            raise InputError(
                f"state has {len(self.state.plays)} plays: there must be "
                f"{len(self.constants.thresholds)}"
            )


def describe_law(found: LoopComparison) -> LoopFile:
    """Return the file of the law that a comparison carries."""
    runs, law = found.runs, found.fit.law
    last = runs.slices[-1]
    rows = found.parts.fitted
    end = 0.0
    if len(found.fit.factors):
        end = float(found.fit.factors.sum())  # drifts are 1 at the end
    return LoopFile(
        law=found.law,
        input=runs.input_title,
        output=runs.output_title,
        lowest=float(runs.input[rows].min()),
        highest=float(runs.input[rows].max()),
        band=found.band,
        offset=end,
        constants=law,
        state=law.run(runs.input[last], found.fit.starts[-1])[1],
    )


def write_law(found: LoopComparison, path: Path) -> None:
    """Write the law that a comparison carries, and for people what came of the fit.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    record = write_record(describe_law(found))
    said = found.to_dict()
    report = {key: said[key] for key in said if key not in ("constants", "predicted")}
    data = {"kind": KIND, "version": VERSION, **record, "fit": report}
    text = json.dumps(data, indent=2) + "\n"
    write_text(path, text if path.suffix.lower() == ".json" else format_yaml(data))


def read_law(path: str | os.PathLike[str]) -> LoopFile:
    """Read a file of `write_law`.

    Raises
    ------
    FileFormatError
        If it is none.
    """
    source = check_path("path", path)
    data = load_data(source)
    try:
        if not isinstance(data, dict) or data.get("kind") != KIND:
            raise InputError(f"it has no 'kind: {KIND}': it is no file of 'bozzini hysteresis fit'")
        return read_record({key: x for key, x in data.items() if key != "fit"}, LoopFile)
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopPrediction(ReasonedResult):
    """What a law predicts of a table.

    Attributes
    ----------
    file : LoopFile
    runs : LoopRuns
    predicted : ndarray, shape (n,)
    judged : ndarray of bool, shape (n,)
        Rows whose output is known and did not settle the start.
    error : float
        Root mean square over these; NaN without any.
    coverage : float
        Share of these within the band.
    notes : tuple of str
    reason : str
    residual : float
        `error`, 0 where no output is known.
    """

    file: LoopFile
    runs: LoopRuns
    predicted: Floats
    judged: Mask
    error: float
    coverage: float
    notes: tuple[str, ...]
    reason: str = ""

    @property
    def residual(self) -> float:
        """The error, 0 where no output is known."""
        return 0.0 if math.isnan(self.error) else self.error

    def to_dict(self) -> Json:
        """Return the result as plain values, with the table."""
        values = {
            "law": self.file.law,
            "rows": len(self.runs),
            "judged": int(self.judged.sum()),
            "error": self.error,
            "band_95": self.file.band,
            "coverage": self.coverage,
            "notes": self.notes,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
            "columns": self.list_table(),
        }
        return {name: to_plain(value) for name, value in values.items()}

    def list_table(self) -> Json:
        """Return the rows with what is predicted and its band."""
        runs = self.runs
        name, unit = split_title(self.file.output)
        end = f" [{unit}]" if unit else ""
        known = {runs.output_title: runs.output} if runs.output_title else {}
        return {
            "run": runs.list_labels(),
            runs.time_title or "row": runs.time,
            runs.input_title: runs.input,
            **known,
            f"predicted {name}{end}": self.predicted,
            f"lowest {name}{end}": self.predicted - self.file.band,
            f"highest {name}{end}": self.predicted + self.file.band,
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw what is predicted, and measured, over the input, and return the axes."""
        runs = self.runs
        axes = take_axes(ax, x=self.file.input, y=self.file.output)
        if runs.output_title:
            axes.plot(runs.input, runs.output, ".", ms=2.5, color="0.4", label="measured")
        for k, place in enumerate(runs.slices):
            label = None if k else self.file.law
            axes.plot(runs.input[place], self.predicted[place], lw=1.2, color="C0", label=label)
        axes.legend(frameon=False, fontsize=9)
        return axes


def predict_loops(file: LoopFile, runs: LoopRuns, *, resume: bool = False) -> LoopPrediction:
    """Return what a law predicts of runs.

    The start of a run is that which fits its first rows (`count_lead`) best. With `resume` the
    first run goes on from the end of what was fitted. Where neither is known, plays begin in their
    middle.

    Raises
    ------
    InputError
        If units differ from those of the fit.
    """
    check_units(runs, input_title=file.input, output_title=file.output)
    law, notes = file.constants, list(runs.notes)
    predicted, judged = np.zeros(len(runs)), np.isfinite(runs.output)
    blind = 0
    for k, place in enumerate(runs.slices):
        inputs, outputs = runs.input[place], runs.output[place]
        start: float | LoopState | None = file.state if resume and not k else None
        if start is None:
            lead = np.arange(len(inputs)) < count_lead(inputs)
            lead &= np.isfinite(outputs)
            if lead.any():
                wanted = np.where(np.isfinite(outputs), outputs, 0.0) - file.offset
                own = Samples((inputs,), wanted, np.empty((len(inputs), 0)))
                fit = Fitted(law, (0.0,), np.empty(0))
                start = settle_starts(fit, own, lead).starts[0]
                judged[place][lead] = False
            else:
                blind += 1
        predicted[place] = law.trace(inputs, start) + file.offset
    if blind:
        notes.append(
            f"the start of {blind} run(s) is not known: without an output in the first rows the "
            "plays begin in their middle, and the band does not hold until the input has turned"
        )
    beyond = float(np.mean((runs.input < file.lowest) | (runs.input > file.highest)))
    if beyond > 0.0:
        notes.append(
            f"{100.0 * beyond:.3g} % of the rows are beyond the inputs fitted, "
            f"{file.lowest:.4g} to {file.highest:.4g}: the band does not hold there"
        )
    left = (runs.output - predicted)[judged]
    known = bool(left.size)
    return LoopPrediction(
        file=file,
        runs=runs,
        predicted=predicted,
        judged=judged,
        error=float(np.sqrt(np.mean(np.square(left)))) if known else math.nan,
        coverage=float(np.mean(np.abs(left) <= file.band)) if known else math.nan,
        notes=tuple(notes),
    )
