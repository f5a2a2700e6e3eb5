"""A motion as a film: its page in a browser without a window, or a plan in X-ray pictures."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity
from ..duct.base import Duct, SampledField
from ..duct.field import build_field
from ..duct.shapes.cones import RoundCones
from ..errors import InputError, MissingExtraError, OutputError
from ..io.files import check_new_file, write_atomically
from ..motion.plan import Plan
from ..plot.figures import film_motion
from ..plot.plan_data import read_centreline
from ..progress import Progress, no_progress
from .make_view import Wall, view_plan
from .page import render_page
from .view import View

Picture = NDArray[np.uint8]

SUFFIXES = (".mp4", ".gif")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_FLAGS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@dataclass(frozen=True, kw_only=True)
class FilmOptions:
    """How a plan is filmed.

    Parameters
    ----------
    duration : float
        Of the film [s]; the steps are spread evenly over it.
    rate : int
        Pictures a second.
    style : {"auto", "page", "x-ray"}
        The page in 3-D by Chromium and playwright, or X-ray pictures; "auto" is the page where both
        are there.

    Raises
    ------
    InputError
        If a value is not legal.
    """

    duration: float = quantity("time", "Length of the film.", default=8.0, low=0.1, high=600.0)
    rate: int = quantity(whole=True, help="Pictures a second.", default=25, low=1, high=60)
    style: str = quantity(
        "text",
        "The page in 3-D (needs Chromium and playwright), or X-ray pictures.",
        default="auto",
        words=("auto", "page", "x-ray"),
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class Film:
    """What was filmed: where it is, how it was drawn, and how many pictures it has."""

    path: Path
    style: str
    pictures: int


def record_plan(
    plan: Plan,
    path: str | os.PathLike[str],
    *,
    wall: Wall | None = None,
    options: FilmOptions | None = None,
    progress: Progress = no_progress,
) -> Film:
    """Film a plan and return where that is.

    Parameters
    ----------
    plan : Plan
    path : path-like
        The film, ``.mp4`` or ``.gif``.
    wall : tract or duct, optional
        The wall; without it the widest tube round the centreline is shown.
    options : FilmOptions, optional
    progress : callable

    Raises
    ------
    InputError
        If the page is asked for and cannot be shown.
    MissingExtraError
        If ``imageio-ffmpeg`` is not installed, for an MP4.
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    options = options or FilmOptions()
    if options.style == "page" or (options.style == "auto" and find_browser() is not None):
        return record_view(view_plan(plan, wall), path, options=options, progress=progress)
    target = _check_film(path)
    count = min(plan.steps, max(2, round(options.duration * options.rate)))
    pictures = film_motion(plan, _make_field(plan, wall), count=count)
    return _write_film(target, (pictures, count), "x-ray", options, progress)


def record_view(
    view: View,
    path: str | os.PathLike[str],
    *,
    options: FilmOptions | None = None,
    progress: Progress = no_progress,
) -> Film:
    """Film the page of a view and return where that is.

    Parameters
    ----------
    view : View
        Its first body moves.
    path : path-like
        The film, ``.mp4`` or ``.gif``.
    options : FilmOptions, optional
    progress : callable

    Raises
    ------
    InputError
        If the page cannot be shown.
    MissingExtraError
        If ``imageio-ffmpeg`` is not installed, for an MP4.
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    options = options or FilmOptions()
    target, browser = check_view_film(path)
    steps = len(view.bodies[0].joints)
    count = min(steps, max(2, round(options.duration * options.rate)))
    chosen = np.unique(np.linspace(0, steps - 1, count).astype(int))
    return _write_film(
        target, (_film_page(view, browser, chosen), count), "page", options, progress
    )


def check_view_film(path: str | os.PathLike[str]) -> tuple[Path, str]:
    """Return the file and the browser of what `record_view` writes; raises what that does."""
    target, browser = _check_film(path), find_browser()
    if browser is None:
        raise InputError("the page needs Chromium and the package playwright: one is not there")
    return target, browser


def _check_film(path: str | os.PathLike[str]) -> Path:
    target = Path(path)
    check_new_file(target, SUFFIXES, force=True)
    if target.suffix.lower() == ".mp4":
        _check_encoder()
    return target


def _write_film(
    target: Path,
    film: tuple[Iterator[Picture], int],
    style: str,
    options: FilmOptions,
    progress: Progress,
) -> Film:
    """Write pictures, and how many there will be, as they come."""
    pictures, count = film
    taken = 0

    def watch() -> Iterator[Picture]:
        nonlocal taken
        for picture in pictures:
            progress("film", min(taken / count, 1.0))
            taken += 1
            yield picture

    rate = max(1.0, count / options.duration)
    encode = _encode_mp4 if target.suffix.lower() == ".mp4" else _encode_gif
    write_atomically(target, lambda place: encode(place, watch(), rate))
    return Film(path=target, style=style, pictures=taken)


def find_browser() -> str | None:
    """Return the program that shows the page, None without it or without playwright."""
    try:
        import playwright  # noqa: F401
    except ImportError:
        return None
    return next((found for found in map(shutil.which, BROWSERS) if found), None)


def _make_field(plan: Plan, wall: Wall | None) -> SampledField:
    """Return distances to the wall, or to the tube round the centreline of a plan."""
    if wall is None:
        line = read_centreline(plan)
        wall = RoundCones(line.points, line.radius)
    field = wall.sample() if isinstance(wall, Duct) else build_field(wall)
    if not isinstance(field, SampledField):
        raise InputError("the wall is planar: a film needs one in space")
    return field


def _film_page(view: View, browser: str, steps: NDArray[np.int64]) -> Iterator[Picture]:
    """Give the pictures of the page, step by step."""
    with tempfile.TemporaryDirectory(prefix="bozzini-") as folder:
        page = Path(folder) / "view.html"
        page.write_text(render_page(view), encoding="utf-8")
        with _open_page(page, browser) as take:
            for step in steps:
                yield take(int(step))


@contextmanager
def _open_page(page: Path, browser: str) -> Iterator[Callable[[int], Picture]]:
    """Give what takes the picture of a step."""
    import io

    from PIL import Image
    from playwright.sync_api import Error, sync_playwright

    show = """step => new Promise(done => {
        document.querySelector(".bozzini").classList.add("film");
        viewer.seek(step);
        requestAnimationFrame(() => requestAnimationFrame(done));
    })"""
    # The sandbox of Chromium does not work for the superuser, in containers above all.
    flags = _FLAGS + (["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])
    try:
        with sync_playwright() as driver:
            program = driver.chromium.launch(executable_path=browser, args=flags)
            try:
                tab = program.new_page(
                    viewport={"width": 1280, "height": 720}, color_scheme="dark", offline=True
                )
                tab.goto(page.as_uri())
                tab.wait_for_selector(".bozzini .stage")

                def take(step: int) -> Picture:
                    tab.evaluate(show, step)
                    image = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
                    return np.asarray(image, dtype=np.uint8)

                yield take
            finally:
                program.close()
    except Error as error:
        words = str(error).splitlines()[0]
        raise OutputError(f"{browser} cannot show the page: {words}; try --style x-ray") from None


def _check_encoder() -> None:
    try:
        import imageio_ffmpeg  # noqa: F401
    except ImportError:
        raise MissingExtraError("imageio-ffmpeg", "film") from None


def _encode_mp4(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    from imageio_ffmpeg import write_frames

    first = next(pictures)
    size = (first.shape[1], first.shape[0])
    writer = write_frames(str(path), size, fps=rate, codec="libx264", macro_block_size=2)
    writer.send(None)
    try:
        for picture in chain([first], pictures):
            writer.send(np.ascontiguousarray(picture))
    finally:
        writer.close()


def _encode_gif(path: Path, pictures: Iterator[Picture], rate: float) -> None:
    from PIL import Image

    # By default colours of few pixels are lost: those of the clearance, on a scope that is small.
    method = Image.Quantize.FASTOCTREE
    sized = (Image.fromarray(picture).resize((960, 540)) for picture in pictures)
    images = (picture.quantize(method=method, dither=Image.Dither.NONE) for picture in sized)
    first = next(images)
    first.save(
        path, format="GIF", save_all=True, append_images=images, duration=1000.0 / rate, loop=0
    )
