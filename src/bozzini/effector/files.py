"""Files of fitted end-effectors: design, muscles, motion, how they are seen, and the fit."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Literal

from ..checks import check_kind, choose, quantity
from ..io.records import load_record, save_record
from ..muscle import MODELS
from ..results import Shown
from .design import EffectorDesign, PlacedMuscle
from .effector import Effector
from .fit import EffectorFit
from .motion import EffectorMotion
from .rest import RESTS, Rest
from .section import MusclePull
from .view import TipView


@dataclass(frozen=True, kw_only=True)
class EffectorFile(Shown):
    """What the file of an end-effector holds.

    Parameters
    ----------
    kind : str
        ``"bozzini-effector"``, by which the file is known.
    version : int
        Of the format: 1.
    muscles : tuple of PlacedMuscle
    section : mapping of str to float
        The other fields of `EffectorDesign`.
    model : str
        Name of the model of the muscles, in `bozzini.muscle.MODELS`.
    choices : mapping of str to str
        Choices of the model.
    motion : EffectorMotion
    pulls : tuple of MusclePull
        Laws of pull in place of the model; empty for none.
    view : TipView
        How it is seen.
    per_volt : float
        Pressure per volt of the regulators [MPa]; 0 where commands are pressures.
    scale : float
        Factor on the commanded pressures.
    intervals : mapping of str to tuple
        Value and ends of the 95 % interval of each number fitted; the value alone where it is not
        determined.
    band : tuple of float
        Half width that held 95 % of what runs left out showed.
    rms : float
        Root mean square distance of what was fitted [mm].
    source : str
        Name of the table that was fitted.
    rest : str
        Name of the rule of `bozzini.effector.rest.RESTS` that learned what the fit leaves over;
        empty for none.
    rest_channels : tuple of str
        What was seen where it learned.
    rest_numbers : mapping of str to tuple
        The rule, as of its `pack`.
    """

    kind: Literal["bozzini-effector"] = field(default_factory=lambda: "bozzini-effector")
    version: int = quantity(default=1, low=1, high=1, whole=True)
    muscles: tuple[PlacedMuscle, ...]
    section: Mapping[str, float] = field(default_factory=dict)
    model: str = "energy"
    choices: Mapping[str, str] = field(default_factory=dict)
    motion: EffectorMotion = field(default_factory=EffectorMotion)
    pulls: tuple[MusclePull, ...] = ()
    view: TipView = field(default_factory=TipView)
    per_volt: float = 0.0
    scale: float = 1.0
    intervals: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    band: tuple[float, ...] = ()
    rms: float = 0.0
    source: str = ""
    rest: str = ""
    rest_channels: tuple[str, ...] = ()
    rest_numbers: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def build_rest(self) -> Rest | None:
        """Return the rule for what the fit leaves over, or None.

        Raises
        ------
        InputError
            If there is no such rule, or its numbers are none of it.
        """
        return RESTS.choose(self.rest).unpack(self.rest_numbers) if self.rest else None

    def build(self) -> Effector:
        """Return the end-effector.

        Raises
        ------
        InputError
            If there is no such model, or a field is none of a design's.
        """
        section: dict[str, object] = dict(self.section)
        if "segments" in section:
            section["segments"] = int(self.section["segments"])
        known = [item.name for item in fields(EffectorDesign) if item.name != "muscles"]
        for name in section:
            choose("field of the section", name, dict.fromkeys(known))
        design = EffectorDesign(muscles=self.muscles, **section)  # type: ignore[arg-type]
        kind = MODELS.choose(self.model)
        model = partial(kind, **self.choices) if self.choices else kind
        return Effector(design, model, motion=self.motion, pulls=self.pulls or None)

    @classmethod
    def of(
        cls,
        fit: EffectorFit,
        *,
        model: str = "energy",
        choices: Mapping[str, str] | None = None,
        per_volt: float | None = None,
        rest: str = "",
    ) -> EffectorFile:
        """Return what the file of a fit holds; `rest` is the name of its rule, if it has one.

        Raises
        ------
        InputError
            If the rule is one that cannot be written.
        """
        effector = fit.effector
        design = effector.design
        return cls(
            muscles=design.muscles,
            section={
                item.name: float(getattr(design, item.name))
                for item in fields(design)
                if item.name != "muscles"
            },
            model=model,
            choices=choices or {},
            motion=effector.motion,
            pulls=effector.pulls or (),
            view=fit.view,
            per_volt=per_volt or 0.0,
            scale=fit.scale,
            intervals={
                one.name: tuple(filter(math.isfinite, (one.value, one.low, one.high)))
                for one in fit.estimates
            },
            band=() if fit.band is None else tuple(fit.band.tolist()),
            rms=fit.rms,
            source=fit.prediction.data.source,
            rest=rest,
            rest_channels=fit.prediction.data.channels if rest else (),
            rest_numbers=fit.rest.pack() if rest and fit.rest is not None else {},
        )


def read_effector(path: str | os.PathLike[str]) -> EffectorFile:
    """Read the file of an end-effector: JSON if it ends in ``.json``, YAML otherwise.

    Raises
    ------
    FileFormatError
        If it is not such a file; the message names the file and the field.
    """
    return load_record(path, EffectorFile, name="the effector file")


def open_effector(name: str) -> Effector:
    """Return the end-effector of a preset, or of a file whose name ends in .yaml, .yml or .json.

    Raises
    ------
    InputError
        If there is no such preset, or a value is not legal.
    FileFormatError
        If it is no file of an end-effector.
    """
    is_file = name.endswith((".yaml", ".yml", ".json"))
    return read_effector(name).build() if is_file else Effector.from_preset(name)


def write_effector(path: str | os.PathLike[str], effector: EffectorFile) -> Path:
    """Write the file of an end-effector that `read_effector` reads back exactly.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    check_kind("effector", effector, EffectorFile)
    return save_record(effector, path, note="Numbers are in mm, N, MPa, rad and s.")
