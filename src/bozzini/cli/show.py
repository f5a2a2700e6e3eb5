"""``bozzini show``: one page in 3-D for everything that has a shape."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import ZipFile, is_zipfile

import click

from ..errors import FileFormatError, InputError
from ..study.options import ReadOptions
from ._tract_options import list_given, report_findings
from .common import (
    INPUT,
    Answer,
    CheckedCommand,
    answer_options,
    options_of,
)

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..motion.plan import Plan
    from ..scene.make_view import Shown, Wall
    from ..scene.view import View

__all__ = ["command"]

_DATA = (".json", ".yaml", ".yml")


@click.command("show", cls=CheckedCommand)
@click.argument("sources", metavar="FILE...", nargs=-1, required=True, type=INPUT)
@options_of(ReadOptions, "reading")
@click.option("--open", "opened", is_flag=True, help="Open the page in the browser.")
@answer_options(
    ".html",
    default="bozzini-view.html",
    show_default=True,
    help="The page: one file that needs no network.",
)
def command(sources: tuple[Path, ...], reading: ReadOptions, opened: bool, answer: Answer) -> None:
    """Show plans, tracts, shapes, robots, muscles and points in 3-D, on one page.

    A FILE is a plan or a robot's motion along one (.npz), a label volume or a surface as for
    'bozzini plan', shapes, a robot, a muscle or a distal head (.yaml, .json; a muscle is shown as
    the three of an end-effector), or points (.csv with x_mm, y_mm and z_mm, as the tips of a
    workspace). A plan and the file that it was made from are shown together. The page turns, plays,
    measures, and shows what a camera at the tip sees.
    """
    if list_given(reading) and not any(map(_is_tract, sources)):
        raise InputError("there is no tract among the files: leave out how one is read")
    with answer.show_progress() as progress:
        plans = {path: _read_plan(path) for path in sources if _is_plan(path)}
        things: list[Shown] = []
        for k, path in enumerate(sources):
            progress("read", k / len(sources))
            known = plans.get(path)
            things.append(known or read_shown(path, reading, tuple(plans.values())))
        progress("view", 0.0)
        view = _join(sources, things)
        from ..io.files import write_text
        from ..scene.page import render_page

        page = write_text(answer.target, render_page(view))
    parts = {
        "surfaces": [item.name for item in view.surfaces],
        "bodies": [item.name for item in view.bodies],
        "points": [item.name for item in view.points],
    }
    size = page.stat().st_size
    result = {"file": str(page), "bytes": size, "title": view.title, **parts, "notes": view.notes}
    answer.give(result, "\n".join([f"{page}: {size / 1e6:.2f} MB", *view.notes]))
    if opened:
        import webbrowser

        webbrowser.open(page.absolute().as_uri())


def _read_plan(path: Path) -> Plan:
    from ..anatomy.files import check_file
    from .routing import read_plan

    check_file(path)
    return read_plan(path)


def read_shown(path: Path, reading: ReadOptions, plans: tuple[Plan, ...]) -> Shown:
    """Return what a file holds that can be shown; a tract as the plan that was made from it says.

    Raises
    ------
    FileFormatError
        If it cannot be read, or holds nothing of that kind.
    InputError
        If it is to be read otherwise than for the plan.
    """
    from ..anatomy.files import check_file

    check_file(path)
    suffix = path.suffix.lower()
    if suffix == ".npz":
        from ..motion.actuate.actuation import Actuation

        return Actuation.load(path)
    if suffix in _DATA:
        return _read_data(path)
    if suffix == ".csv":
        from ..scene.view import Cloud
        from .routing import read_points

        return Cloud(points=read_points(path), name=path.stem)
    from ..motion.verify import is_made_from, read_input

    plan = next((each for each in plans if is_made_from(each, path)), None)
    tract = reading.read(path) if plan is None or list_given(reading) else read_input(plan, path)
    if plan is not None and list_given(reading) and not _is_same(tract, read_input(plan, path)):
        names = ", ".join(f"--{name}" for name in list_given(reading))
        raise InputError(
            f"{path} is not read with {names} as for the plan that was made from it: leave that out"
        )
    report_findings(tract.findings)
    return tract


def _is_same(one: LabelTract | SurfaceTract, other: LabelTract | SurfaceTract) -> bool:
    """Whether two readings of a file have the same lumen."""
    import numpy as np

    names = ("mask", "affine") if hasattr(one, "mask") else ("vertices", "faces")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


def _read_data(path: Path) -> Shown:
    """Return the shapes, the robot, the end-effector or the head of a file of plain data."""
    from ..io.records import load_data

    data = load_data(path)
    keys = data if isinstance(data, dict) else {}
    if "shapes" in keys:
        from ..duct.shape_files import load_shapes

        return load_shapes(path)
    if "sections" in keys:
        from ..continuum import ContinuumRobot

        return ContinuumRobot.from_yaml(path)
    if "camera" in keys:
        from ..head.design import read_head

        return read_head(path)
    if "muscle" in keys:
        from ..effector import Effector
        from ..effector.design import DEFAULT_PRESET, effector_preset
        from ..muscle import read_muscle

        muscle = read_muscle(path).muscle
        design = effector_preset(DEFAULT_PRESET)
        muscles = tuple(replace(each, muscle=muscle) for each in design.muscles)
        return Effector(design.replace(muscles=muscles, backbone_length=muscle.length))
    raise FileFormatError(
        f"{path} has no 'shapes', 'sections', 'muscle' or 'camera': it must hold shapes, a robot, "
        "a muscle or a head"
    )


def _is_plan(path: Path) -> bool:
    """Whether a file is a plan's, and not the motion of a robot that follows one."""
    if path.suffix.lower() != ".npz" or not is_zipfile(path):
        return path.suffix.lower() == ".npz"
    with ZipFile(path) as parts:
        return "bends.npy" not in parts.namelist()


def _is_tract(path: Path) -> bool:
    return path.suffix.lower() not in (".npz", ".csv", *_DATA)


def _join(sources: tuple[Path, ...], things: list[Shown]) -> View:
    """Return the view of all; a plan takes the only wall that there is."""
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..duct.base import Duct
    from ..motion.plan import Plan
    from ..scene.make_view import join_views, make_view

    walls = [
        (path, thing)
        for path, thing in zip(sources, things, strict=True)
        if isinstance(thing, (LabelTract, SurfaceTract, Duct))
    ]
    plans = [thing for thing in things if isinstance(thing, Plan)]
    own = [_find_own(plan, walls) for plan in plans] if walls else []
    wall = own[0] if own else None
    views = [
        make_view(thing, wall if thing is plans[0] else None) if plans else make_view(thing)
        for thing in things
        if thing is not wall
    ]
    return join_views(views, title=", ".join(path.name for path in sources))


def _find_own(plan: Plan, walls: list[tuple[Path, Wall]]) -> Wall:
    """Return the wall that a plan was made in.

    Raises
    ------
    InputError
        If it is none of them.
    """
    from ..duct.base import Duct
    from ..motion.verify import is_made_from, rebuild_field
    from .routing import check_lumen

    reasons = []
    for path, wall in walls:
        known = is_made_from(plan, path)
        if known is None:
            try:
                check_lumen(
                    plan, path, wall if isinstance(wall, Duct) else rebuild_field(plan, wall)
                )
            except InputError as error:
                reasons.append(str(error))
                continue
        elif not known:
            reasons.append(f"{path} is not the file that the plan was made from")
            continue
        return wall
    raise InputError(reasons[0])
