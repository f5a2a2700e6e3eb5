"""What ``bozzini muscle compare`` and ``bozzini muscle fit`` share: the table of measurements."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..muscle.dataset import Measurements
    from ..muscle.design import Muscle

__all__ = [
    "check_friction",
    "data_argument",
    "mean_option",
    "note_data",
    "read_data",
    "units_option",
]

data_argument = click.argument("source", metavar="DATA", type=click.Path(path_type=Path))
units_option = click.option(
    "--unit",
    "units",
    multiple=True,
    metavar="COLUMN=UNIT",
    help="Unit of a column that states none, e.g. pressure=kPa; can be repeated.",
)
mean_option = click.option(
    "--mean", "take_mean", is_flag=True, help="Take the mean of inflation and deflation."
)


def read_data(
    source: Path, muscle: Muscle, units: tuple[str, ...], take_mean: bool
) -> Measurements:
    from ..errors import InputError
    from ..muscle.dataset import read_measurements

    table = {}
    for item in units:
        name, mark, unit = item.partition("=")
        if not (name and mark and unit):
            raise InputError(f"--unit is '{item}': it must be COLUMN=UNIT, such as pressure=kPa")
        table[name.strip()] = unit.strip()
    data = read_measurements(source, muscle=muscle, units=table)
    return data.mean_of_directions() if take_mean else data


def check_friction(
    fields: Mapping[str, float | None], data: Measurements, *, free: tuple[str, ...]
) -> None:
    from ..errors import InputError

    given = fields.get("friction_length") is not None and "friction_length" not in free
    if given and not (data.direction != "").any():
        raise InputError("--friction-length has no effect: no row of the data has a direction")


def note_data(data: Measurements) -> str:
    lines = [f"note: {text}\n" for text in data.notes]
    if data.ignored:
        lines.insert(0, f"ignored columns: {', '.join(data.ignored)}\n")
    return "".join(lines)
