"""Files of muscles: what is known of one, its model and constants, its mounting, and its fit."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ..checks import (
    check_integer,
    check_kind,
    check_number,
    check_word,
    choose,
    list_quantities,
    quantity,
)
from ..errors import InputError
from ..io.records import load_record, save_record
from ..results import Shown
from .design import Muscle
from .ends import EndEffects

if TYPE_CHECKING:
    from .model import MuscleModel


@dataclass(frozen=True, kw_only=True)
class FitSummary(Shown):
    """How the numbers of a muscle file were fitted; numbers are in mm, N, MPa and rad.

    Parameters
    ----------
    response : str
        What was fitted: ``"force"``, ``"contraction"`` or ``"pressure"``.
    names : tuple of str
        What was fitted, in the order of the covariance: fields of the muscle, constants of the
        model, effects of the ends.
    covariance : tuple of tuple of float
        Covariance of the numbers named, shape (k, k).
    shared, each : tuple of str
        Which of the names are one number for all specimens, and which one for each.
    specimens : mapping of str to mapping of str to float
        Measured geometry and fitted numbers of each specimen, by its name.
    source : str
        Name of the file of measurements.
    rms : float, optional
        Root of the mean square of what the fit leaves over, in the unit of the response.
    rows : int
        How many rows were fitted.
    freedom : int
        Degrees of freedom of the covariance; 0 for rows less constants.
    anchored : bool
        Whether the offset of each specimen followed from its length without load at a pressure.
    """

    response: Literal["force", "contraction", "pressure"]
    names: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = ()
    shared: tuple[str, ...] = ()
    each: tuple[str, ...] = ()
    specimens: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    source: str = ""
    rms: float | None = None
    rows: int = 0
    freedom: int = 0
    anchored: bool = False

    def __post_init__(self) -> None:
        size = len(self.names)
        if [len(row) for row in self.covariance] != [size] * size:
            raise InputError(f"the covariance must be {size} rows of {size} numbers, as the names")
        for name, row, index in zip(self.names, self.covariance, range(size), strict=True):
            check_number(f"the variance of {name}", row[index], low=0.0)
        for name in (*self.shared, *self.each):
            check_word("a name in shared or each", name, self.names)
        check_integer("rows", self.rows, low=0)
        check_integer("freedom", self.freedom, low=0)
        if self.rms is not None:
            check_number("rms", self.rms, low=0.0)


@dataclass(frozen=True, kw_only=True)
class MuscleFile(Shown):
    """What a muscle file holds.

    Parameters
    ----------
    kind : str
        ``"bozzini-muscle"``, by which the file is known.
    version : int
        Of the format: 1.
    muscle : Muscle
        What is known of the muscle; the rest is unset.
    model : str
        Name of the model, in `bozzini.muscle.MODELS`; empty for none.
    constants : mapping of str to float or str
        Constants and choices of the model.
    ends : EndEffects, optional
        Zero offset, series compliance and slack region; None for none.
    fit : FitSummary, optional
        How the numbers were fitted; None if they were not.

    Raises
    ------
    InputError
        If a value is not legal, or there are constants and no model.
    """

    kind: Literal["bozzini-muscle"] = field(default_factory=lambda: "bozzini-muscle")
    version: int = quantity(default=1, low=1, high=1, whole=True)
    muscle: Muscle
    model: str = ""
    constants: Mapping[str, float | str] = field(default_factory=dict)
    ends: EndEffects | None = None
    fit: FitSummary | None = None

    def __post_init__(self) -> None:
        if self.constants and not self.model:
            raise InputError("there are constants and no model: name it, as in 'model: chou'")

    def build(self, *, length: float | None = None, specimen: str = "") -> MuscleModel:
        """Return the model of the muscle, mounted if the file has effects of the ends.

        Parameters
        ----------
        length : float, optional
            Rest length [mm] in place of the file's, such as that of a specimen not measured.
        specimen : str
            Name of a specimen of the fit, for its geometry and numbers in place of the shared ones.

        Raises
        ------
        InputError
            If the file names no model, there is no such specimen, or the model cannot be made.
        """
        from .ends import MountedMuscle
        from .models import MODELS

        if not self.model:
            raise InputError("the muscle file names no model: add a line such as 'model: chou'")
        changes: dict[str, float] = {}
        if specimen:
            known = {} if self.fit is None else self.fit.specimens
            changes |= choose("specimen", specimen, known)
        if length is not None:
            changes["length"] = length
        fields, effects = list_quantities(Muscle), list_quantities(EndEffects)
        muscle = self.muscle.replace(**{k: x for k, x in changes.items() if k in fields})
        own = {k: x for k, x in changes.items() if k not in fields and k not in effects}
        kind = MODELS.choose(self.model)
        model: MuscleModel = kind(muscle, **{**self.constants, **own})  # type: ignore[call-arg]
        of_ends = {k: x for k, x in changes.items() if k in effects}
        if self.ends is None and not of_ends:
            return model
        ends = EndEffects() if self.ends is None else self.ends
        return MountedMuscle(model, ends.replace(**of_ends))


def read_muscle(path: str | os.PathLike[str]) -> MuscleFile:
    """Read a muscle file: JSON if it ends in ``.json``, YAML otherwise.

    Quantities may have units, such as ``length: 83 mm``; bare numbers are in mm, N, MPa and rad.

    Raises
    ------
    FileFormatError
        If it is not such a file; the message names the file and the field.
    """
    return load_record(path, MuscleFile, name="the muscle file")


def write_muscle(path: str | os.PathLike[str], muscle: MuscleFile) -> Path:
    """Write a muscle file that `read_muscle` reads back exactly; quantities have their units.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    check_kind("muscle", muscle, MuscleFile)
    note = "Numbers without a unit are in mm, N, MPa and rad."
    return save_record(muscle, path, note=note, with_units=True)
