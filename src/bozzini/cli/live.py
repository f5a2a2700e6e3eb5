"""``bozzini live``: keep a scope clear in a tract that moves, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..checks import ceil_mm, check_number, floor_mm, quantity
from ..errors import InputError
from ..motion.live import LiveOptions
from ..study.options import InsertionOptions, PathOptions, ReadOptions
from ._slicer import open_slicer, take_points
from ._tract_options import MovingBody, read_with_options, report_findings, tract_options
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    PICTURES,
    Answer,
    CheckedCommand,
    answer_options,
    options_of,
    run_exit,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..anatomy import TissueMotion
    from ..duct import Centreline
    from ..motion import LiveFrame, LiveRun
    from ..progress import Progress
    from ..scene import SlicerLink
    from ..study import InsertionStudy

__all__ = ["command"]

DEPTH_MAX = 0.95
"""As `bozzini.anatomy.Peristalsis` takes it."""

HEAD_STEP_MM = 1.0
"""The head's step in every frame."""

MOST_FACES = 10_000
"""Of the wall in each frame that 3D Slicer shows."""


@dataclass(frozen=True, kw_only=True)
class TissueOptions:
    """How the tissue moves; what is not given is as in `bozzini.anatomy.tissue`."""

    motion: str = quantity(
        "text",
        "breathing, peristalsis, or a file of displacements (.npz).",
        default="breathing",
    )
    amplitude: float | None = quantity(
        "length", "Of breathing: the largest displacement.  [default: 12mm]", default=None
    )
    wavelength: float | None = quantity(
        "length", "Of breathing: along the body.  [default: 800mm]", default=None, by_name=True
    )
    period: float | None = quantity(
        "time", "Of breathing: how long a breath is.  [default: 4s]", default=None
    )
    depth: float | None = quantity(
        help="Of peristalsis: share of the lumen's width that is closed.  [default: 0.58]",
        default=None,
        by_name=True,
    )

    def prepare(self) -> Callable[[Centreline, str | None, tuple[float, float]], TissueMotion]:
        """Return what makes the motion from a line, the organ, and its lowest and highest z [mm].

        Raises
        ------
        InputError
            If the motion is unknown, its file cannot be read, or a number is not legal for it.
        """
        from ..anatomy.tissue import Breathing, Peristalsis, RecordedMotion

        given = {
            name: value
            for name in ("amplitude", "wavelength", "period", "depth")
            if (value := getattr(self, name)) is not None
        }
        taken = {"breathing": ("amplitude", "wavelength", "period"), "peristalsis": ("depth",)}
        spare = set(given) - set(taken.get(self.motion, ()))
        if spare:
            raise InputError(f"--{min(spare)} was given: --motion {self.motion} has none")
        if self.motion == "peristalsis":
            if self.depth is not None:
                check_number("depth", self.depth, low=0.0, high=DEPTH_MAX)
            return lambda line, *_: Peristalsis(line=line.points, **given)
        if self.motion == "breathing":
            Breathing(**given)  # wrong numbers are told before any long work
            return lambda _, organ, ends: Breathing.of_organ(organ, ends, **given)
        if self.motion.endswith(".npz"):
            motion: TissueMotion = RecordedMotion.load(self.motion)
        else:
            raise InputError(
                f"--motion is '{self.motion}': it must be breathing, peristalsis or an .npz file"
            )
        return lambda *_: motion


@click.command(name="live", cls=CheckedCommand)
@click.argument("source", metavar="INPUT", type=INPUT)
@tract_options
@options_of(MovingBody, "body", leave_out=("robot",))
@options_of(PathOptions, "options", leave_out=("inflate",))
@options_of(TissueOptions, "tissue")
@options_of(LiveOptions, "loop")
@answer_options(
    *PICTURES,
    ".csv",
    igtl=True,
    help="A picture (.png, .svg, .pdf), or a table of the frames (.csv).",
)
def command(
    source: Path,
    reading: ReadOptions,
    body: MovingBody,
    options: PathOptions,
    tissue: TissueOptions,
    loop: LiveOptions,
    answer: Answer,
) -> None:
    """Keep a scope clear in the tract in INPUT while it moves.

    The insertion is planned in the tract at rest. Then, in every frame, the wall is moved, the body
    is moved with the tissue, and the body and the next stretch of the way are planned and certified
    again. Frames follow each other as fast as they are computed; --rate is that of the tissue's
    motion. Exit code 0: every frame's certificate holds until the next frame; 1: not, or the
    scope does not fit at rest; 2: bad input.
    """
    from ..motion import LiveRun, follow_tissue
    from ..study import run_insertion

    make_motion = tissue.prepare()
    link = open_slicer(answer)
    tract = read_with_options(source, reading, answer)
    if link is not None:
        link, options = take_points(link, tract, options)
    insertion = InsertionOptions(**vars(options), method="tube", head_step=HEAD_STEP_MM)
    with answer.show_progress() as progress:
        study = run_insertion(tract, body.scope, options=insertion, progress=progress)
    report_findings(study.findings[len(tract.findings) :])
    if study.plan.status != "complete":
        summary = {"input": source.name, "converged": False, "reason": study.plan.reason}
        answer.give(summary, f"The scope does not fit at rest: {study.plan.reason}.")
        run_exit(EXIT_NEGATIVE)
    low, high = study.field.bounds
    ends = float(low[2]), float(high[2])
    motion = make_motion(study.line, tract.organ, ends)
    surface = None if tract.kind == "labels" else tract
    with answer.show_progress() as progress:
        progress("live", 0.0)
        warm = replace(loop, duration=2.0 / loop.rate)  # so that no compilation is timed
        follow = {"motion": motion, "surface": surface}
        LiveRun.collect(
            follow_tissue(study.plan, study.field, options=warm, **follow),  # type: ignore[arg-type]
            rate=loop.rate,
            motion=motion,
        )
        frames = follow_tissue(study.plan, study.field, options=loop, **follow)  # type: ignore[arg-type]
        if link is not None:
            frames = _show(frames, link, study, motion)
        duration = motion.period if loop.duration is None else loop.duration
        run = LiveRun.collect(_watch(frames, duration, progress), rate=loop.rate, motion=motion)
    answer.write(run.list_columns(), lambda: _draw(run))
    summary = {"input": source.name, "motion": tissue.motion, **run.to_dict(), "file": answer.out}
    answer.give(summary, _describe(run))
    if not run.converged:
        run_exit(EXIT_NEGATIVE)


def _watch(frames: Iterator[LiveFrame], duration: float, progress: Progress) -> Iterator[LiveFrame]:
    for frame in frames:
        progress("live", min(frame.time / duration, 1.0))
        yield frame


def _show(
    frames: Iterator[LiveFrame], link: SlicerLink, study: InsertionStudy, motion: TissueMotion
) -> Iterator[LiveFrame]:
    """Show each frame in 3D Slicer as it comes: wall, scope and what is left of the line."""
    from ..scene.scene import prepare_tract

    wall = prepare_tract(study.find_surface(), max_faces=MOST_FACES)
    for frame in frames:
        link.send_wall(wall.vertices + motion.at(frame.time)(wall.vertices), wall.faces)
        link.send_line(frame.plan.path)
        link.send_scope(frame.body, radius=frame.plan.get_scope().radius)
        yield frame


def _draw(run: LiveRun) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    run.plot(left)
    run.plot_latency(right)
    return figure


def _describe(run: LiveRun) -> str:
    found = run.to_dict()
    total = found["frames"]
    lines = [
        f"{found['frames_held']} of {total} frames are certified until the next one, "
        f"{found['frames_now']} for their own time only, {found['frames_lost']} are not certified, "
        f"{found['frames_refused']} were refused.",
        f"Certified clearance in a frame: {_limit(found['clearance_min_mm'], 'none')}; from one to "
        f"the next: {_limit(found['carried_min_mm'], 'contact is not excluded')}. The wall moves "
        f"by up to {ceil_mm(found['margin_mm'], 3)} mm between frames ({ceil_mm(run.speed, 1)} "
        "mm/s at "
        f"{run.rate:g} Hz).",
        f"Latency {1e3 * found['latency_median_s']:.0f} ms in the median, "
        f"{1e3 * found['latency_p95_s']:.0f} ms at 95 %, "
        f"{1e3 * found['latency_max_s']:.0f} ms at most; {found['frames_late']} frames took longer "
        "than a period.",
    ]
    if run.reason:
        lines.append(f"First of the worst frames: {run.reason}.")
    return "\n".join(lines)


def _limit(length: float | None, otherwise: str) -> str:
    return otherwise if length is None or length < 0.0 else f"at least {floor_mm(length)} mm"
