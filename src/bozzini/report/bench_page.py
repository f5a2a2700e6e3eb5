"""The page of a muscle that was characterised by a camera."""

from __future__ import annotations

from matplotlib.figure import Figure

from ..rig.camera_bench import BenchReport
from .short_page import ShortPage

_LIMITS = (
    "Bars are 95 % intervals of a mean, with what a set-up shares; they hold for this muscle.",
    "Constants are those of the fitted model. Their intervals hold if the model is right, and with "
    "what the pictures share; an error of the transducer's scale is not in them.",
    "The fitted model has one curve: what differs between the two ways is scatter to it.",
)


def make_bench_page(found: BenchReport) -> ShortPage:
    """Return the report of a characterisation by a camera."""
    settled = sum(len(run.rows) - run.flagged for run in found.runs)
    steps = sum(len(run.rows) for run in found.runs)
    good = found.fit is not None and found.fit.trusted
    rows = [
        ("weights", ", ".join(f"{run.stairs.load:g} N" for run in found.runs)),
        ("steps that settled", f"{settled} of {steps}"),
        ("lengths measured", f"{len(found.lengths.found) - found.lengths.found.count(None)} of "
         f"{len(found.lengths.rows)}"),
        ("length that contractions are counted from", f"{found.free_length:.3f} mm"),
    ]  # fmt: skip
    if found.fit is not None:
        rows += found.list_estimates()
        rows.append(("strand length", f"{found.fit.muscle.braid.strand_length:.4g} mm"))
    return ShortPage(
        title=f"Characterisation of {found.runs[0].stairs.specimen or 'a muscle'}",
        label="Fitted" if good else "Not fitted" if found.fit is None else "Fitted, with doubts",
        tone="green" if good and not found.reason else "red" if found.fit is None else "amber",
        sentence=f"{steps} steps under {len(found.runs)} "
        f"weight{'s' * (len(found.runs) > 1)}, {len(found.lengths.rows)} pictures"
        + (f"; contractions are {found.residual:.3f} mm about the fit." if good else "."),
        notes=[found.reason] if found.reason else [],
        figures=_draw(found),
        rows=rows,
        limitations=_LIMITS,
    )


def _draw(found: BenchReport) -> list[tuple[Figure, str]]:
    pictures = [(found.plot, "Contraction over the pressure, up and down, and the fitted curve.")]
    if len({item["direction"] for item in found.lengths.summarise()}) > 1:
        pictures.append((found.plot_hysteresis, "Hysteresis: difference of the two ways."))
    if found.find_stiffness():
        pictures.append((found.plot_stiffness, "Stiffness from the weights, and of the fit."))
    figures = []
    for draw, words in pictures:
        figure = Figure(figsize=(7.0, 4.2), layout="constrained")
        draw(figure.add_subplot())
        figures.append((figure, words))
    return figures
