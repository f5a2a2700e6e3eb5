"""What a ranking of models says of each, and its table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ._folds import CrossValidation
from .calibration import Calibration
from .compare import ModelScore
from .dataset import Measurements

if TYPE_CHECKING:
    from .model import MuscleModel

__all__ = ["RankedModel", "Ranking"]


@dataclass(frozen=True, kw_only=True, eq=False)
class RankedModel:
    """A model fitted to the measurements, and how it fares.

    Parameters
    ----------
    score : ModelScore
        How near it comes, after the fit.
    model : MuscleModel
        The model as fitted.
    calibration : Calibration or None
        Its fit; None if there was nothing to fit.
    held : dict
        Constants that were not fitted although nobody knows them, and why.
    parameters : int
        How many were fitted.
    aicc, bic : float
        Criteria of `bozzini.muscle.information`. A root mean square below 1e-9 of the largest
        contraction counts as that: among models that fit exactly the fewest parameters win.
        `aicc` is infinite with fewer than `parameters` + 3 rows.
    weight : float
        Akaike's weight among the models ranked. Models with one curve and equally many parameters
        count once: `same_as` and the model it names have the same weight.
    validation : CrossValidation or None
        How far off the rows are that were left out of the fit; None if not asked for.
    same_as : str
        A model ranked above that has the same curve; empty if there is none.
    """

    score: ModelScore
    model: MuscleModel
    calibration: Calibration | None
    held: dict[str, str]
    parameters: int
    aicc: float
    bic: float
    weight: float
    validation: CrossValidation | None
    same_as: str = ""

    @property
    def name(self) -> str:
        """The name it was ranked under."""
        return self.score.name

    @property
    def validation_error(self) -> float:
        """Root mean square of the rows left out [mm]; infinite where it could not be had."""
        found = self.validation
        return math.inf if found is None or found.reason else found.error

    @property
    def doubt(self) -> str:
        """Which fits did not converge, in words; empty if all did."""
        words = []
        if self.calibration is not None and not self.calibration.converged:
            words.append("not converged")
        folds = 0 if self.validation is None else self.validation.unsettled
        if folds:
            words.append(f"{folds} of the folds not converged")
        return ", ".join(words)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranking:
    """Models fitted to the same measurements, the best first.

    Parameters
    ----------
    data : Measurements
    models : tuple of RankedModel
    refusals : dict
        Models that were not fitted, and why.
    criterion : str
        One of `CRITERIA`.
    folds : int
        Of the cross-validation; 0 for none.
    seed : int
        Of folds and starts.
    """

    data: Measurements
    models: tuple[RankedModel, ...]
    refusals: dict[str, str]
    criterion: str
    folds: int
    seed: int

    @property
    def notes(self) -> tuple[str, ...]:
        """Which models lack a criterion, and why; empty if none does."""
        lines = []
        without = [entry.name for entry in self.models if math.isinf(entry.aicc)]
        if without:
            last = "" if self.criterion != "aicc" else (
                "; they come last, by BIC" if len(without) < len(self.models)
                else "; the models are ranked by BIC instead"
            )  # fmt: skip
            lines.append(
                f"no AICc for {', '.join(without)}: it needs 3 rows more than constants fitted, "
                f"there are {len(self.data)} row(s){last}"
            )
        last = " (it comes last, by BIC)" if self.criterion == "cv" else ""
        for entry in self.models:
            if entry.validation is not None and entry.validation.reason:
                reason = entry.validation.reason
                lines.append(f"{entry.name}: no error of the rows left out{last}: {reason}")
        return tuple(lines)

    def format_table(self) -> str:
        """Return the ranking as a table of text, with its notes."""
        wide = max([5, *(len(entry.name) for entry in self.models)])
        lines = []
        if self.models:
            head = f"{'model':<{wide}}  standard error      RMSE      bias   largest"
            left_out = "  left out" if self.folds else ""
            lines.append(f"{head}{left_out}  constants  dAICc   dBIC  weight")
        best = {name: min((getattr(entry, name) for entry in self.models), default=0.0)
                for name in ("aicc", "bic")}  # fmt: skip
        counts = {entry.name: entry.parameters for entry in self.models}
        for entry in self.models:
            score = entry.score
            line = (
                f"{score.name:<{wide}}  {score.standard_error:6.3f} mm"
                f"{score.standard_error_percent:5.1f} %{score.rmse:7.3f} mm"
                f"{score.bias:+7.3f} mm{score.largest:7.3f} mm"
            )
            if self.folds:
                error = entry.validation_error
                line += f"{error:7.3f} mm" if math.isfinite(error) else f"{'none':>10}"
            above = f"{entry.aicc - best['aicc']:7.1f}" if math.isfinite(entry.aicc) else "   none"
            counted = counts.get(entry.same_as) != entry.parameters
            weight = f"{entry.weight:.3f}" if counted else f"({entry.weight:.3f})"
            line += f"{entry.parameters:11d}{above}{entry.bic - best['bic']:7.1f}{weight:>8}"
            words = [f"as {entry.same_as}" if entry.same_as else "", entry.doubt]
            lines.append("  ".join([line, *(word for word in words if word)]))
        lines += self.notes
        lines += [f"{name}: not fitted: {reason}" for name, reason in self.refusals.items()]
        return "\n".join(lines)
