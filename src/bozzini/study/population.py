"""Which share of patients a scope fits: a table over tracts, from a study of what fits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..checks import check_number
from ..errors import InputError
from ..report.verdict import SHARE_REACHED
from ..results import ClosedForm, Json
from .definition import Study
from .jobs import InsertionJob

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

UNREACHED = "unreached"
"""The column with the share of lumen that a motion leaves out."""

PATIENTS = ("tract", "phantom")
"""Factors that are patients."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Population(ClosedForm):
    """How many patients each scope fits.

    Attributes
    ----------
    table : pandas.DataFrame
        A row for each scope: its factors; ``patients`` with an answer; of these ``fits`` (proved to
        the end of all of the lumen, and within the study's constraints), ``fits_not`` (proved: no
        way through is so wide) and ``undecided``; ``errors``, which are not among the patients;
        ``share`` that it fits with ``share_low`` and ``share_high``, and ``share_not`` with
        ``share_not_low`` and ``share_not_high``. The share that it fits in truth is at least
        ``share`` and at most 1 - ``share_not`` of these patients.
    scopes : tuple of str
        The columns that are factors.
    level : float
        Probability of the intervals (Wilson's), which are of other patients drawn alike.
    """

    table: pandas.DataFrame
    scopes: tuple[str, ...]
    level: float

    def to_dict(self) -> Json:
        """Return the rows as plain values."""
        rows = self.table.astype(object).where(self.table.notna(), None)
        return {"level": self.level, "scopes": rows.to_dict("records")}

    def list_columns(self) -> Mapping[str, object]:
        """Return the columns of the table."""
        return {str(name): self.table[name].to_numpy() for name in self.table.columns}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the share over the first factor; return the axes."""
        from ..plot.study import draw_population

        return draw_population(self.table, self.scopes, ax)

    def draw(self) -> Figure:
        """Return the same as a figure."""
        from ..plot.style import make_panels

        figure, (axes,) = make_panels()
        self.plot(axes)
        return figure


def is_population(study: Study) -> bool:
    """Whether a study has patients as a factor."""
    return study.spec.job == InsertionJob.name and any(x in study.spec.factors for x in PATIENTS)


def count_fits(study: Study, rows: pandas.DataFrame, *, level: float = 0.95) -> Population:
    """Return which share of the patients of a study each of its scopes fits.

    Parameters
    ----------
    study : Study
        Of the job ``insertion-feasibility``, with ``tract`` or ``phantom`` as a factor, as a grid.
    rows : pandas.DataFrame
        As `read_rows` gives them.
    level : float
        Probability of the intervals.

    Raises
    ------
    InputError
        If it is no such study.
    """
    from scipy.stats import binomtest

    check_number("level", level, low=0.5, high=0.9999)
    if not is_population(study):
        raise InputError(
            f"the study is no population: job {InsertionJob.name} with tract or phantom as a factor"
        )
    sampling = study.spec.sampling
    if sampling is None or sampling.method != "grid":
        raise InputError("a population needs the sampling grid: every scope in every patient")
    if len(rows) != study.rows:
        raise InputError(f"{study.rows - len(rows)} of {study.rows} rows are missing: resume it")
    scopes = [axis for axis in study.axes if axis.name not in PATIENTS]
    names = [study.columns[axis.name] for axis in scopes]
    groups = rows.groupby(names, sort=True, dropna=False) if names else [((), rows)]
    table = []
    for key, group in groups:
        code, feasible = group["code"].to_numpy(), group["feasible"].to_numpy()
        if UNREACHED in group:
            feasible = feasible & ~(group[UNREACHED].to_numpy() > SHARE_REACHED)
        # Another motion may keep the constraints, and another way reach the rest of the lumen.
        beyond = (code == 0) & ~feasible
        counts = {
            "fits": int(feasible.sum()),
            "fits_not": int((code == InsertionJob.TOO_WIDE).sum()),
            "undecided": int((beyond | (code == InsertionJob.NOT_FOUND)).sum()),
        }
        patients = sum(counts.values())
        row: Json = {
            **dict(zip(names, key, strict=True)),
            "patients": patients,
            **counts,
            "errors": len(group) - patients,
        }
        for column, count in (("share", counts["fits"]), ("share_not", counts["fits_not"])):
            low = high = value = np.nan
            if patients:
                value = count / patients
                low, high = binomtest(count, patients).proportion_ci(level, method="wilson")
            row |= {column: value, f"{column}_low": low, f"{column}_high": high}
        table.append(row)
    import pandas

    return Population(table=pandas.DataFrame(table), scopes=tuple(names), level=level)
