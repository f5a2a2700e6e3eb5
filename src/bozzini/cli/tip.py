"""What ``bozzini effector tip-error`` and ``bozzini continuum tip-error`` share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..results import format_rows
from ..units import parse_quantity
from .common import (
    EXIT_NEGATIVE,
    PICTURES,
    Answer,
    answer_options,
    gather,
    gather_once,
    option,
    run_exit,
    split_setting,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from ..study.tip import DrawOptions, TipError


@dataclass(frozen=True, kw_only=True)
class InputSpread:
    """What is not known exactly, as the options ask for it: standard deviations, and a fit."""

    command_sd: float
    tension_sd: float = 0.0
    deviations: tuple[str, ...] = ()
    fit: Path | None = None


def _make_options(**given: object) -> DrawOptions:
    from ..study.tip import DrawOptions

    return DrawOptions(**given)  # type: ignore[arg-type]


draw_options = gather(
    "options",
    _make_options,
    option("--draws", "Draws that are computed exactly.", int, default=1024),
    option("--seed", "Of the draws.", int, default=0),
    option(
        "--level",
        "Share of the errors given that the ellipse holds; it is no band of poses.",
        float,
        default=0.95,
    ),
)

tip_answer = answer_options(
    ".csv", *PICTURES, help="The draws as a table (.csv), or a picture.", quiet=False
)


def parse_deviations(
    texts: Sequence[str], find_kind: Callable[[str], str], *, example: str
) -> dict[str, float]:
    """Return standard deviations of ``--sd NAME=VALUE``."""
    pairs = (split_setting("--sd", text, f"NAME=VALUE, such as {example}") for text in texts)
    return {
        name: parse_quantity(value, find_kind(name))
        for name, value in gather_once("--sd", pairs).items()
    }


def give_tip_error(
    found: TipError, more: Mapping[str, object], answer: Answer, *, notes: Sequence[str] = ()
) -> None:
    """Write the answer; a first order that does not hold is a negative one."""
    from ..study.tip import ELLIPSE_OF

    answer.write(found.list_columns(), found.draw)
    plain = found.to_dict()
    lengths = ", ".join(f"{value:.3g}" for value in plain["semi_axes_mm"])
    ends = ", ".join(f"{value:.3g}" for value in plain["ellipse_mm"])
    place = ", ".join(f"{value:.3f}" for value in plain["tip_mm"])
    rows = [
        [name, f"{each['sd']:.4g} {each['unit']}".strip(), f"{each['alone_mm']:.3g}"]
        for name, each in plain["errors"].items()
    ]
    lines = [
        *(f"note: {note}" for note in notes),
        f"tip at ({place}) mm, in the frame of the {found.frame}",
        f"semi-axes {lengths} mm (one standard deviation), {ends} mm ({100 * found.level:g} %), of "
        f"{ELLIPSE_OF}",
        "left-out error of the fit: "
        + ("not known" if found.left_out is None else f"{found.left_out:.3g} mm rms, not in these"),
        *(
            []
            if found.within is None
            else [
                f"no row of the fit was of such motions ({found.within[0]}): how far predictions "
                "miss there is not known"
                if math.isnan(found.within[1])
                else f"{found.within[2]:.0%} of predictions of the tip are within "
                f"{found.within[1]:.3g} mm at such motions ({found.within[0]}), by rows left out"
            ]
        ),
        f"{plain['draws']} exact draws: covariance {100 * found.residual:.1f} % from the first "
        f"order, {100 * found.coverage:.1f} % in the ellipse",
        format_rows(["error", "sd", "moves the tip by [mm]"], rows),
    ]
    lines += [f"the first order does not hold: {found.reason}"] if found.reason else []
    answer.give({**plain, **more, "notes": notes, "file": answer.out}, "\n".join(lines))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)
