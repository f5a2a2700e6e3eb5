"""What the searches for robots are asked: light, for the command line makes its options of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...checks import check_fields, check_integer, quantity, show_value
from ...errors import InputError
from ...results import Shown


@dataclass(frozen=True, kw_only=True)
class InsertionRankOptions(Shown):
    """What `insertion_rank` tries.

    Parameters
    ----------
    modes : tuple of int
        Numbers of independent routings; each is two cables, on both sides of the backbone.
    sections : tuple of int
        Numbers of even sections, of three cables each.
    stride : int
        Every so many steps of about 2 mm a pose is fitted.
    rounds : int
        Rounds of the fit of routings to positions, in each law; 0 for none.
    exact : bool
        Whether tensions are fitted by the exact law as well.
    offset_max : float
        Largest distance of a cable from the backbone [mm].
    stiffness : float
        EI of the backbone [N mm^2]; GJ is ``EI / 1.3``.
    """

    modes: tuple[int, ...] = (4, 6, 8, 10, 12, 16)
    sections: tuple[int, ...] = (4, 6, 8, 12)
    stride: int = quantity(
        help="A pose every so many steps of 2 mm.",
        low=1,
        high=100,
        whole=True,
        default=2,
        by_name=True,
    )
    rounds: int = quantity(
        help="Rounds of the fit of routings to positions.",
        low=0,
        high=1000,
        whole=True,
        default=12,
        by_name=True,
    )
    exact: bool = True
    offset_max: float = quantity(
        "length",
        "Largest distance of a cable from the backbone.",
        low=0.0,
        high=1e3,
        low_open=True,
        default=2.0,
        by_name=True,
    )
    stiffness: float = quantity(
        "rigidity", "EI of the backbone.", low=1e-9, high=1e15, default=200.0, by_name=True
    )

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("modes", "sections"):
            object.__setattr__(self, name, _check_counts(name, getattr(self, name), high=100))


@dataclass(frozen=True, kw_only=True)
class RobotSearch(Shown):
    """What robots are tried for a tract.

    Parameters
    ----------
    diameter_min, diameter_max : float
        Of the body [mm]; 0 for up to what the bounds allow.
    diameters : int
        How many between these are tried.
    sections : tuple of int
        Numbers of sections, fewest first.
    offset_share : float
        Where the three tendons of each section run, against the body's radius.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    diameter_min: float = quantity(
        "length", "Thinnest body that is tried.", low=0.5, high=1e3, default=3.0
    )
    diameter_max: float = quantity(
        "length",
        "Thickest body that is tried (0: what the bounds allow).",
        low=0.0,
        high=1e3,
        default=0.0,
    )
    diameters: int = quantity(
        help="How many diameters are tried.", low=1, high=50, whole=True, default=4
    )
    sections: tuple[int, ...] = (2, 3, 4, 6, 8, 12)
    offset_share: float = quantity(
        help="Where tendons run, as a share of the radius.",
        low=0.0,
        high=1.0,
        low_open=True,
        default=0.8,
    )

    def __post_init__(self) -> None:
        check_fields(self)
        counts = sorted(_check_counts("sections", self.sections, high=50))
        if not counts:
            raise InputError("sections is empty: give at least one number")
        object.__setattr__(self, "sections", tuple(counts))


def _check_counts(name: str, counts: object, *, high: int) -> tuple[int, ...]:
    if not isinstance(counts, Sequence):
        raise InputError(
            f"{name} is {show_value(counts)}: it must be whole numbers, such as (4, 6)"
        )
    return tuple(
        check_integer(f"{name}[{index}]", count, low=1, high=high)
        for index, count in enumerate(counts)
    )
