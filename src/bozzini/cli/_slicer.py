"""What the commands share that show their work in 3D Slicer: the link, its points."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import click

from ..anatomy.tract import name_place, to_point
from ..study.options import PathOptions
from .common import ARGUMENTS, Answer

if TYPE_CHECKING:
    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..scene import SlicerLink

_Options = TypeVar("_Options", bound=PathOptions)


def open_slicer(answer: Answer) -> SlicerLink | None:
    """Return a link that lasts as long as the command, if one was asked for."""
    address = answer.igtl
    if address is None:
        return None
    from ..scene.slicer import SlicerLink, is_loopback, parse_address

    host, _ = parse_address(address)
    if not is_loopback(host):
        click.echo(
            f"bozzini: warning: {host} is not this computer alone: OpenIGTLink neither encrypts "
            "nor asks who is there",
            err=True,
        )
    link = SlicerLink.open(
        address, announce=lambda text: click.echo(f"bozzini: note: {text}", err=True)
    )
    return click.get_current_context().with_resource(link)


def take_points(
    link: SlicerLink, tract: LabelTract | SurfaceTract, options: _Options
) -> tuple[SlicerLink, _Options]:
    """Return the link in the tract's frame, and options with Slicer's points where none is given.

    A target is a place that the centreline passes.
    """
    if tract.frame is None:
        click.echo(
            "bozzini: warning: the file does not state where its axes point: 3D Slicer is told "
            "RAS; give --frame",
            err=True,
        )
    link = replace(link, frame=tract.frame or "RAS")
    given: dict[str, object] = {}
    for role, places in link.receive_points().items():
        points = [to_point(place.round(3)) for place in places]
        name = "via" if role == "target" else role
        if getattr(options, name) not in (None, ()):
            click.echo(f"bozzini: note: --{name} was given: that of 3D Slicer is not", err=True)
            continue
        points = points if name == "via" else points[:1]
        given[name] = tuple(points) if name == "via" else points[0]
        arguments = click.get_current_context().meta[ARGUMENTS]
        for point in points:
            click.echo(f"bozzini: note: {role} of 3D Slicer: {name_place(point)}", err=True)
            arguments.append(f"--{name}=" + ",".join(f"{value:.9g}mm" for value in point))
    return link, replace(options, **given)  # type: ignore[arg-type]
