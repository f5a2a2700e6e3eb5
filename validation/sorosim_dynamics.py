"""Releases of a rod by another group's Cosserat solver, SoRoSim, computed again by `simulate`.

    python validation/sorosim_dynamics.py FILE.txt ... --length 600mm --radius 0.8mm

holds any rod of the same layout against its files; `--help` lists what is taken of the published
one unless given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
import numpy as np
from numpy.typing import NDArray
from section import Bound, Section, draw_axes, format_rows
from sorosim_statics import INTO_WORLD, SPRING_STEEL, Specimen

from bozzini.cli.common import options_of
from bozzini.continuum import (
    ContinuumRobot,
    DynamicsOptions,
    PointLoad,
    ShapeHistory,
    Wire,
    linearise,
    simulate,
)
from bozzini.continuum import Section as RobotSection

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEP_S = 2.5e-3
ELEMENTS = 30
COARSER = (20, 10)
"""Numbers of elements that the page has errors of, too."""
SHOWN = 1.5
"""How much of a release the picture has [s]."""
SWINGING = slice(200, 1400)
"""Rows whose zeros give the frequency."""
STANDING = slice(-400, None)


@dataclass(frozen=True)
class Release:
    """A rod let go from a held shape, in the frame of its base.

    Attributes
    ----------
    specimen : Specimen
    damping_time : float
        Time constant of the material [s].
    gravity : (3,) ndarray
        Acceleration [m/s^2].
    moments, forces : (2, 3) ndarray
        What holds it in the middle and at the tip before [N mm], [N].
    times : (k,) ndarray
        [s].
    tip : (k, 3) ndarray
        Its places [mm].
    """

    specimen: Specimen
    damping_time: float
    gravity: NDArray[np.float64]
    moments: NDArray[np.float64]
    forces: NDArray[np.float64]
    times: NDArray[np.float64]
    tip: NDArray[np.float64]

    def simulate(self, elements: int = ELEMENTS) -> ShapeHistory:
        """Compute it again."""
        robot, options = self.describe(elements)
        places = 0.5 * self.specimen.length, None
        held = [
            PointLoad(arc_length=place, force=tuple(force), moment=tuple(moment))
            for place, force, moment in zip(places, self.forces, self.moments, strict=True)
        ]
        return simulate(robot, self.times, held_by=held, options=options)

    def describe(self, elements: int) -> tuple[ContinuumRobot, DynamicsOptions]:
        """Return it as a robot of so many segments."""
        rod = self.specimen
        wire = Wire(
            diameter=2.0 * rod.radius,
            modulus=rod.modulus,
            poisson_ratio=rod.poisson_ratio,
            density=rod.density,
        )
        section = RobotSection(length=rod.length, radius=rod.radius, discs=elements, wire=wire)
        options = DynamicsOptions(
            segment="arc",
            damping_time=self.damping_time,
            gravity=tuple(self.gravity),
            max_step=STEP_S,
        )
        return ContinuumRobot((section,)), options

    def rest(self) -> NDArray[np.float64]:
        """Return the tip of a model that is at rest at once."""
        robot, options = self.describe(ELEMENTS)
        found = linearise(robot, options=options)
        return np.tile(found.frames[-1, :3, 3], (len(self.times), 1))

    def swing(self) -> NDArray[np.float64]:
        """Return the tip of a model that swings about its rest in its slowest mode alone."""
        robot, options = self.describe(ELEMENTS)
        found = linearise(robot, options=options)
        rest, ratio = found.frames[-1, :3, 3], float(found.damping_ratio[0])
        speed = 2.0 * math.pi * float(found.frequency[0])
        phase = speed * math.sqrt(1.0 - ratio**2) * self.times
        left = np.exp(-ratio * speed * self.times) * np.cos(phase)
        return np.asarray(rest + left[:, None] * (self.tip[0] - rest))


def read_release(path: Path, specimen: Specimen = SPRING_STEEL) -> Release:
    """Read a file: damping and gravity, wrenches, then times and poses of middle and tip."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head, held, *rows = [np.array(line.split(), np.float64) for line in lines if line.strip()]
    wrenches, table = held[1:].reshape(4, 3) @ INTO_WORLD, np.array(rows)
    return Release(
        specimen=specimen,
        damping_time=float(head[0]),
        gravity=head[-3:] @ INTO_WORLD,
        moments=1e3 * wrenches[0::2],
        forces=wrenches[1::2],
        times=table[:, 0],
        tip=1e3 * table[:, 10:13] @ INTO_WORLD,
    )


@dataclass(frozen=True)
class Errors:
    """Root mean square errors of the tip by the length, over all and over the first second.

    ``frequency`` is that of a tip over that of the file's; NaN of a tip that does not swing.
    """

    whole: float
    first_second: float
    frequency: float


def compare(data: Release, tip: NDArray[np.float64]) -> Errors:
    """Hold places of a tip (k, 3) against a release."""
    squares = np.sum((tip - data.tip) ** 2, axis=1) / data.specimen.length**2
    return Errors(
        whole=float(np.sqrt(squares.mean())),
        first_second=float(np.sqrt(squares[data.times <= data.times[0] + 1.0].mean())),
        frequency=find_frequency(data.times, tip) / find_frequency(data.times, data.tip),
    )


def find_frequency(times: NDArray[np.float64], tip: NDArray[np.float64]) -> float:
    """Frequency [Hz] of a tip (k, 3) about where it ends, by zeros of its largest coordinate."""
    own = tip[:, np.argmax(np.ptp(tip, axis=0))]
    own, times = (own - own[STANDING].mean())[SWINGING], times[SWINGING]
    rise = np.flatnonzero((own[:-1] < 0.0) & (own[1:] >= 0.0))
    if len(rise) < 2:
        return math.nan
    part = own[rise] / (own[rise] - own[rise + 1])
    zeros = times[rise] + part * (times[rise + 1] - times[rise])
    return float((len(zeros) - 1) / (zeros[-1] - zeros[0]))


def _simulate_with(elements: int) -> Callable[[Release], NDArray[np.float64]]:
    return lambda data: data.simulate(elements).tip


MODELS: dict[str, Callable[[Release], NDArray[np.float64]]] = {
    **{f"`simulate`, {n} elements": _simulate_with(n) for n in (ELEMENTS, *COARSER)},
    "slowest mode alone": Release.swing,
    "at rest at once": Release.rest,
}
"""The first has bounds, the last two are baselines."""


def validate(folder: Path, images: Path) -> Section:
    """Return the section, and draw a release."""
    paths = sorted(folder.glob("steel_*.txt"), key=lambda path: int(path.stem.split("_")[1]))
    releases = [read_release(path) for path in paths]
    found = {name: [compare(data, tip(data)) for data in releases] for name, tip in MODELS.items()}
    rows, head = [], ["tip", "rms over 10 s [%]", "first second [%]", "frequency [%]"]
    for name, errors in found.items():
        off = max(abs(one.frequency - 1.0) for one in errors)
        worst = [max(one.whole for one in errors), max(one.first_second for one in errors), off]
        rows.append([name, *(f"{100.0 * x:.3f}" if np.isfinite(x) else "none" for x in worst)])
    with draw_axes(images / "validation_sorosim_dynamics.png") as axes:
        _draw(releases[0], axes)
    own = next(iter(found.values()))
    return Section(
        title="Releases of a steel rod by another solver",
        source="as of the static shapes above.",
        licence="MIT.",
        text=(
            f"{len(releases)} releases from a held shape, 10 s at 200 Hz, under gravity in any "
            f"direction, with the damping of the files, in steps of {1e3 * STEP_S:g} ms. Nothing "
            "is fitted. Worst errors of the tip, by the length, and of the frequency:",
            "",
            "![Tip of a release](images/validation_sorosim_dynamics.png)",
            "",
            *format_rows(head, rows),
        ),
        bounds=(
            Bound("tip over 10 s, worst", 100.0 * max(one.whole for one in own), 0.2, "%"),
            Bound(
                "tip in the first second, worst",
                100.0 * max(one.first_second for one in own),
                0.2,
                "%",
            ),
            Bound(
                "frequency, worst",
                100.0 * max(abs(one.frequency - 1.0) for one in own),
                0.2,
                "%",
            ),
        ),
    )


def _draw(data: Release, axes: Axes) -> None:
    axis, shown = int(np.argmax(np.ptp(data.tip, axis=0))), data.times <= SHOWN
    axes.plot(data.times[shown], data.tip[shown, axis], label="SoRoSim", linewidth=3, alpha=0.4)
    for name in (next(iter(MODELS)), "slowest mode alone"):
        label = name.replace("`", "")
        axes.plot(data.times[shown], MODELS[name](data)[shown, axis], label=label, linewidth=1)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tip across [mm]")


@click.command()
@click.argument(
    "files", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True, dir_okay=False)
)
@options_of(Specimen, "specimen")
def main(files: Sequence[Path], specimen: Specimen) -> None:
    """Compute the releases in FILES again, and print by how much their tips differ."""
    for path in files:
        data = read_release(path, specimen)
        moved = data.simulate()
        if not moved.converged:
            print(f"{path.name}: {moved.reason}")
            continue
        off = compare(data, moved.tip)
        print(
            f"{path.name}: tip off by {100.0 * off.whole:.3g} % of the length rms, "
            f"{100.0 * off.first_second:.3g} % in the first second; frequency off by "
            f"{100.0 * (off.frequency - 1.0):.3g} %"
        )


if __name__ == "__main__":
    main()
