"""The job of studies that drives a scope's motion with contact; `bozzini.studies` names it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeVar

from ..checks import Quantity, list_quantities
from ..errors import InputError
from ..study.factors import Value
from ..study.jobs import TRACT_NEEDED, RowJob, list_tract_inputs, plan_row
from .options import ExecuteOptions, ScopeOptions, WallOptions

T = TypeVar("T", ExecuteOptions, ScopeOptions, WallOptions)


class ExecutionJob(RowJob):
    """A scope's motion through a tract, planned and driven with contact: forces and errors."""

    name = "execution"
    chunk = 2
    needed = TRACT_NEEDED

    @classmethod
    def list_inputs(cls, names: tuple[str, ...]) -> Mapping[str, Quantity]:
        """Return those of the tract and the scope, and the options of wall, scope and drive."""
        options = (ExecuteOptions, ScopeOptions, WallOptions)
        return {
            **list_tract_inputs(),
            **{name: known for kind in options for name, known in list_quantities(kind).items()},
        }

    @property
    def outputs(self) -> Mapping[str, str]:
        """Whether it comes through (1 or 0), and largest forces and errors."""
        return {
            "complete": "",
            "tip_progress": "mm",
            "normal_peak": "N",
            "normal_sum": "N",
            "resultant": "N",
            "push_force": "N",
            "tip_error": "mm",
            "clearance": "mm",
            "work": "N mm",
        }

    def measure(self, row: Mapping[str, Value]) -> Mapping[str, float]:
        """Return what came of driving the motion once."""
        from .study import Scenery

        options = _take(ExecuteOptions, row)
        if options.drive == "tendons":
            raise InputError("drive is tendons: a study has no motion of a tendon robot")
        made = plan_row(row)
        scenery = Scenery(
            plan=made.plan,
            duct=made.duct,
            scope=_take(ScopeOptions, row),
            wall=_take(WallOptions, row),
        )
        found = scenery.run(options).summarise()
        units = {"": "", "mm": "_mm", "N": "_N", "N mm": "_N_mm"}
        values = {name: found[f"{name}{units[unit]}"] for name, unit in self.outputs.items()}
        return {name: math.nan if x is None else float(x) for name, x in values.items()}


def _take(kind: type[T], row: Mapping[str, Value]) -> T:
    """Return options with what a row has of them."""
    given: dict[str, object] = {}
    for name, known in list_quantities(kind).items():
        if name in row:
            value = row[name]
            number = value if known.kind == "text" else float(value)
            given[name] = int(number) if known.whole else number
    return kind(**given)  # type: ignore[arg-type]
