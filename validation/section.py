"""What a set of measured data contributes to the page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from bozzini.continuum import RobotFit


@dataclass(frozen=True)
class Bound:
    """An error that was measured, and the largest that is allowed."""

    what: str
    measured: float
    required: float
    unit: str

    @property
    def is_kept(self) -> bool:
        """Whether it is not above what is allowed; a NaN is."""
        return self.measured <= self.required


@dataclass(frozen=True)
class Section:
    """Title, source with its reference, licence, lines of Markdown, and bounds."""

    title: str
    source: str
    licence: str
    text: tuple[str, ...]
    bounds: tuple[Bound, ...] = ()


def format_rows(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [f"| {' | '.join(cells)} |" for cells in (head, *rows)]
    return [lines[0], "|---" * len(head) + "|", *lines[1:]]


def describe_baselines(fit: RobotFit) -> str:
    """Return what commands alone predict of the rows that a fit left out, and what its band holds.

    Raises
    ------
    ValueError
        If it left none out.
    """
    if fit.band is None:
        raise ValueError("the fit left no rows out")
    shown = name_baselines({one.names[0]: one.rms for one in fit.baselines}, "mm")
    return (
        f"Commands alone miss rows left out by {shown}; {100.0 * fit.band.coverage:.0f} % are in "
        "the fit's band."
    )


def name_baselines(errors: Mapping[str, float], unit: str) -> str:
    """Return errors of baselines by their names."""
    return ", ".join(
        f"{error:.1f} {unit} ({name.removesuffix(' of the commands').removeprefix('mean of the ')})"
        for name, error in errors.items()
    )


@contextmanager
def draw_axes(path: Path) -> Iterator[Axes]:
    """Give axes to draw on, add the legend, and write the picture."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.0, 3.2), layout="constrained")
    yield axes
    handles, labels = axes.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    axes.legend(named.values(), named.keys(), fontsize="small")
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)
