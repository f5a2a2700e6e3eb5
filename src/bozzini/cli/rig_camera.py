"""``bozzini rig characterise --camera``: a muscle's lengths from pictures, and its fit."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError, OutputError
from ..units import parse_quantity
from .common import (
    EXIT_NEGATIVE,
    INPUT,
    Answer,
    check_target,
    gather,
    option,
    refuse_options,
    run_exit,
)

if TYPE_CHECKING:
    from ..rig import Host
    from ..rig.camera_bench import BenchReport
    from ..rig.characterise import Gauge, PictureSource
    from ..rig.stairs import Stairs
    from ..vision import Camera, RenderedSetup, StripBoard
    from .muscle_options import Request

_SECOND = 0.1  # N on top of the first weight

OpenHost = Callable[[float], AbstractContextManager["tuple[Host, Gauge | None]"]]
"""Opens a rig whose muscle holds a weight [N]: its host, and of a plant the true contraction."""


@dataclasses.dataclass(frozen=True)
class CameraRequest:
    """A camera, as the options ask for it."""

    camera: str | None
    weight_texts: str | None
    strips: Path | None
    cameras_file: Path | None
    height: float
    ring: float
    free: str | None

    @property
    def is_rendered(self) -> bool:
        """Whether the pictures are rendered."""
        return self.camera == "rendered"

    def check(self, *, port: str | None, hook: str | None) -> None:
        """Refuse what does not go together."""
        if self.camera is None:
            names = [item.name for item in dataclasses.fields(self)]
            refuse_options(names, "without --camera")
            return
        if hook is not None:
            raise InputError("--hook and --camera both take the pictures: give one")
        if self.is_rendered and port is not None:
            raise InputError("--camera rendered shows the emulated rig: leave out --port")
        if self.is_rendered and (self.strips or self.cameras_file):
            raise InputError("--camera rendered has a board and camera of its own: leave out files")
        if not self.is_rendered:
            self.load()

    def load(self) -> tuple[StripBoard, Camera]:
        """Return the board and the camera of the files."""
        from .vision import LengthFiles

        if self.strips is not None and self.cameras_file is not None:
            board, camera = LengthFiles(self.strips, self.cameras_file).load()
            if camera is not None:
                return board, camera
        raise InputError("a real camera needs --strips and --cameras, see 'bozzini vision'")

    def list_weights(self, stairs: Stairs) -> tuple[float, ...]:
        """Return the weights [N], from the least; that of the stairs if none are given.

        The emulated muscle then holds a second one, without which the braid is not told.
        """
        if self.weight_texts is None:
            second = (stairs.load + _SECOND,) if self.is_rendered else ()
            return (stairs.load, *second)
        texts = self.weight_texts.split(",")
        return tuple(sorted(parse_quantity(text.strip(), "force") for text in texts))

    def list_free(self) -> tuple[str, ...]:
        """Return the names of what is fitted; none if it is left to the default."""
        texts = (self.free or "").split(",")
        return tuple(text.strip().replace("-", "_") for text in texts if text.strip())


camera_options = gather(
    "seen",
    CameraRequest,
    option(
        "--camera NAME",
        "Take a picture at each step, measure the lengths, and fit: 'rendered', the number of a "
        "camera for OpenCV, or a film.",
    ),
    option(
        "--weights weight_texts F,...",
        "Tensions that the muscle holds, a run each, with --camera, such as 0.05N,0.15N (default: "
        "that of --load, and with 'rendered' 0.1 N more).",
    ),
    option("--strips FILE", "The board of strips behind the muscle, with a real camera.", INPUT),
    option("--cameras cameras_file FILE", "The calibrated camera.", INPUT),
    option("--height", "Of the muscle's axis over the board.", "length", default="2.8mm"),
    option("--ring", "Length of a ring on the muscle.", "length", default="2mm"),
    option(
        "--free NAME,...",
        "What is fitted, with --camera (default: modulus,braid-angle,offset).",
    ),
)


def characterise_by_camera(
    seen: CameraRequest,
    open_host: OpenHost,
    stairs: Stairs,
    *,
    asked: Request,
    answer: Answer,
    seed: int,
) -> None:
    """Run a characterisation by a camera, write its files, and answer."""
    import numpy as np

    from ..io.files import reserve_directory
    from ..muscle import preset
    from ..report.bench_page import make_bench_page
    from ..rig.camera_bench import FREE, CameraBench, RenderedCamera, VideoCamera
    from ..vision import LengthOptions, RenderedSetup, StripBoard
    from ..vision.planning import DEMO_LENGTH, DEMO_SETUP

    table = answer.target
    pictures, lengths = (
        table.with_name(f"{table.stem}-{name}") for name in ("pictures", "lengths")
    )
    if pictures.exists() and any(pictures.iterdir()):
        raise OutputError(f"{pictures} is not empty: pictures need an empty directory")
    page = table.with_suffix(".html")
    check_target(page, (".html",), force=answer.force)
    check_target(table.with_name(f"{table.stem}-fit.yaml"), (".yaml",), force=answer.force)
    muscle = asked.muscle
    size = {"height": seen.height, "diameter": 2.0 * muscle.outer_radius, "ring": seen.ring}
    known = LengthOptions(**size)
    if seen.is_rendered:
        known = dataclasses.replace(DEMO_LENGTH, **size)
    setup: RenderedSetup | None = None
    if seen.is_rendered:
        board = StripBoard()
        random = np.random.default_rng([seed, 7])
        setup = RenderedSetup.draw(DEMO_SETUP, board, options=known, random=random)
        camera = setup.camera
    else:
        board, camera = seen.load()
    typical = preset("effector-45")
    start = muscle.replace(modulus=typical.modulus, braid_angle=typical.braid_angle)
    bench = CameraBench(
        stairs=stairs,
        weights=seen.list_weights(stairs),
        board=board,
        camera=camera,
        known=known,
        model=asked.make(),
        muscle=start if seen.is_rendered else muscle,
        free=seen.list_free() or FREE,
    )

    @contextmanager
    def open_rig(weight: float, folder: Path) -> Iterator[tuple[Host, PictureSource]]:
        with ExitStack() as stack:
            host, read = stack.enter_context(open_host(weight))
            if setup is not None and read is not None:
                run = bench.weights.index(weight)
                yield (
                    host,
                    RenderedCamera(
                        folder=folder,
                        read=read,
                        rest_length=muscle.length,
                        setup=setup,
                        seed=1_000_003 * seed + 10_007 * run,
                    ),
                )
                return
            if len(bench.weights) > 1:
                if not sys.stdin.isatty():
                    raise InputError("several --weights are hung by hand: run it at a terminal")
                click.pause(f"Hang {weight:g} N from the muscle, and press a key ...", err=True)
            video = VideoCamera(folder=folder, name=str(seen.camera), size=camera.size)
            yield host, stack.enter_context(video)

    with reserve_directory(lengths, force=answer.force):
        with answer.show_progress() as progress:
            found = bench.run(open_rig, pictures, progress=progress)
        files = found.save(table, force=answer.force)
    files["report"] = make_bench_page(found).write(page)
    board.save(pictures / "board.yaml")
    answer.give({**found.to_dict(), "files": files, "pictures": pictures}, _describe(found, files))
    if not found.converged:
        run_exit(EXIT_NEGATIVE)


def _describe(found: BenchReport, files: dict[str, object]) -> str:
    lines = [f"{name:<14}{text}" for name, text in found.list_estimates()]
    if found.fit is None:
        lines = [f"not fitted: {found.trouble}"]
    else:
        lines.append(f"contractions are {found.residual:.3g} mm about the fit")
    lines += [
        f"stiffness at {1e3 * item.pressure:g} kPa, {item.direction}: {item.stiffness:.3g} "
        f"(95 %: {2.0 * item.uncertainty:.2g}) N/mm"
        for item in found.find_stiffness()
        if math.isclose(item.pressure, found.runs[0].stairs.highest)
    ]
    lines += [f"note: {found.reason}"] if found.reason else []
    return "\n".join([*lines, *(f"{name}: {path}" for name, path in files.items())])
