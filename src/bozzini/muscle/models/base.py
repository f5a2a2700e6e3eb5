"""What the models of the catalogue share: a card, and the keywords it names."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_range
from ...errors import BozziniError, InputError
from ..braid import Braid
from ..design import Muscle
from ..hysteresis import Hysteresis
from ..model import check_hysteresis
from ._describe import describe_card
from ._take import take_keywords
from .card import Card
from .explicit import ANGLES, PRESSURE_LIMIT, ExplicitModel

__all__ = ["ANGLES", "PRESSURE_LIMIT", "TYPICAL_PRESSURE", "CatalogueModel"]

TYPICAL_PRESSURE = 0.5
"""Pressure at which a first guess of fitted constants is Gaylord's [MPa]."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, init=False)
class CatalogueModel(ExplicitModel):
    """A model of the survey (thesis chapter 2): an explicit pull at a pressure and a length.

    A subclass brings a `card` and what `ExplicitModel` asks for, its pull.

    The survey's symbols are the muscle's: ``l0`` is `Muscle.active_length` (a dead length is in
    no paper, but costs nothing), ``r0`` is `Muscle.braid_radius`, ``t0`` the thickness of the
    tube, which touches the braid: the models know no gap. ``theta`` is measured from the axis.

    Parameters
    ----------
    muscle : Muscle
        The design.
    as_printed : bool
        Whether to take the equation as the thesis prints it, errata and all; no difference where
        the print is right.
    hysteresis : Hysteresis, optional
        Operator for `trace_contraction`.
    **given
        Parameters, choices and laws of the `card`.

    Raises
    ------
    MissingLawError
        If a law is needed that the survey does not hold; the message names the paper.
    InputError
        If a keyword is unknown, a parameter is missing or outside its bounds, or the printed
        equation cannot be evaluated.
    """

    muscle: Muscle
    as_printed: bool
    hysteresis: Hysteresis | None
    _given: tuple[tuple[str, Any], ...]
    braid: Braid = field(repr=False, compare=False)

    card: ClassVar[Card]

    def __init_subclass__(cls, **rest: Any) -> None:
        super().__init_subclass__(**rest)
        card = cls.__dict__.get("card")
        if card is not None:
            cls.name = card.name
            cls.__doc__ = f"{inspect.cleandoc(cls.__doc__ or '')}\n\n{describe_card(card)}"
            fields = (item.name for item in dataclasses.fields(Muscle))
            cls.unused = tuple(name for name in fields if name not in card.uses)

    def __init__(
        self,
        muscle: Muscle,
        *,
        as_printed: bool = False,
        hysteresis: Hysteresis | None = None,
        **given: Any,
    ) -> None:
        check_hysteresis(hysteresis)
        if as_printed and self.card.unprintable:
            raise InputError(
                f"the model {self.card.name} cannot be evaluated as printed: "
                f"{self.card.unprintable}; leave as_printed out"
            )
        taken = take_keywords(self.card, given, as_printed=as_printed)
        braid = Braid(
            length=muscle.active_length, radius=muscle.braid_radius, angle=muscle.braid_angle
        )
        for name, value in (
            ("muscle", muscle),
            ("as_printed", bool(as_printed)),
            ("hysteresis", hysteresis),
            ("_given", tuple(taken.items())),
            ("braid", braid),
        ):
            object.__setattr__(self, name, value)
        self._check()

    def __repr__(self) -> str:
        words = [repr(self.muscle)]
        words += ["as_printed=True"] if self.as_printed else []
        words += [] if self.hysteresis is None else [f"hysteresis={self.hysteresis!r}"]
        words += [f"{name}={value!r}" for name, value in self._given]
        return f"{type(self).__name__}({', '.join(words)})"

    @classmethod
    def guess_parameters(cls, muscle: Muscle) -> dict[str, float]:
        """Return where a fit of the parameters may begin, for a muscle.

        The default, else the neutral value, else the middle of the bounds; a model may know
        better. What is not needed while another parameter is 0 is left out.
        """
        guess = {}
        for item in cls.card.parameters:
            value = item.default if item.default is not None else item.neutral
            if value is not None or not item.only_with:
                guess[item.name] = sum(item.bounds) / 2.0 if value is None else value
        return guess

    @property
    def keywords(self) -> dict[str, Any]:
        """Parameters, choices and laws of this model, as its constructor takes them."""
        return dict(self._given)

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters of the `card`."""
        given = self.keywords
        return {item.name: given[item.name] for item in self.card.parameters if item.name in given}

    def replace(self, muscle: Muscle | None = None, **changes: Any) -> CatalogueModel:
        """Return this model with another muscle, or some keywords changed.

        Raises
        ------
        InputError
            As the constructor does.
        """
        kept = {"as_printed": self.as_printed, "hysteresis": self.hysteresis, **self.keywords}
        return type(self)(self.muscle if muscle is None else muscle, **{**kept, **changes})

    def _check(self) -> None:
        """Raise `InputError` if muscle and keywords do not go together."""

    def _call(self, name: str, *arguments: Floats) -> Floats:
        """Answer of a law given by the user, of the arguments' shape and finite, or InputError.

        The law has arrays of its own, to write to as well.
        """
        law: Callable[..., ArrayLike] = self.keywords[name]
        words = f"answer of {name}"
        try:
            given = law(*(np.array(argument) for argument in arguments))
        except BozziniError:
            raise
        except Exception as error:  # a law is the user's: it may raise anything
            raise InputError(self._say_failed(name, error)) from error
        answer = check_array(words, given)
        check_range(words, answer, -1e300, 1e300)
        try:
            return np.broadcast_to(answer, arguments[0].shape)
        except ValueError:
            raise InputError(
                f"{words} has shape {answer.shape}: it must be {arguments[0].shape}"
            ) from None

    def _say_failed(self, name: str, error: Exception) -> str:
        law = next(law for law in self.card.laws if law.name == name)
        said = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(": ")
        return (
            f"the law {name} of the model {self.name} raised {said}: it must take arrays "
            f"({', '.join(law.arguments)}) and return one of their shape"
        )
