"""What a study is asked for: how a tract is read, where the centreline runs, how a scope moves.

The command line makes its options from these fields. Nothing heavy is imported here, so that its
help appears at once; the names of organs, methods and shapes are therefore repeated, and a test
compares them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..checks import check_fields, check_number, quantity
from ..errors import InputError
from ..motion.planners import PLANNERS, PlannerOptions, check_route
from ..results import Json, Shown

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..anatomy.tract import LabelTract, SurfaceTract
    from ..motion import Scope

ORGANS = ("upper-tract", "small-bowel", "colon", "airway", "vessel")
"""As `bozzini.anatomy.ORGANS`."""

FITTED_KINDS = ("cones", "cylinders", "superellipsoids")
"""As `bozzini.duct.fitting.fit` knows them."""

ROUTES = {"in": (1.0,), "in-out": (1.0, 0.0), "in-out-in": (1.0, 0.0, 1.0)}
"""Names of routes: fractions of the path that the head goes to in turn."""

VOXEL_MIN = 0.01
"""Finest grid [mm]: a hundredth of the smallest tract."""

INFLATION_MAX = 30.0
"""As `bozzini.duct.field.INFLATION_MAX` [mm]."""


def copy_field(kind: type, name: str) -> Any:
    """Return a field as another dataclass has it."""
    known = kind.__dataclass_fields__[name]  # type: ignore[attr-defined]
    return field(default=known.default, metadata=known.metadata)


@dataclass(frozen=True, kw_only=True)
class ReadOptions(Shown):
    """How a file of a tract is read.

    Parameters
    ----------
    labels, part, unit, frame, repair
        See `bozzini.anatomy.read_tract`.
    organ : {"upper-tract", "small-bowel", "colon", "airway", "vessel"}, optional
        Which organ it is, in place of what the file states.

    Raises
    ------
    InputError
        If the organ is unknown.
    """

    labels: Sequence[int | str] | None = quantity(
        "labels",
        "Labels that are lumen, by number or name: 1,2,colon; or all.",
        default=None,
        example="1,2,3",
    )
    part: tuple[str, ...] = quantity(
        "text",
        "The part of a scene, or of a mesh (1 is the largest), to read (name or number); may be "
        "repeated: the parts are united.",
        default=(),
        example="1",
    )
    unit: str | None = quantity(
        "text", "Unit of a surface file (default: mm; GLB: m).", default=None, example="mm"
    )
    frame: str | None = quantity(
        "text",
        "Where the file's axes point in the patient, such as RAS or LPS (default: as the file "
        "states).",
        default=None,
        example="RAS",
        by_name=True,
    )
    repair: bool = quantity("flag", "Mend small faults of a surface, and list them.", default=False)
    organ: str | None = quantity(
        "text",
        "Which organ this is: it decides which end is the entry.",
        default=None,
        words=ORGANS,
        example=ORGANS[0],
    )

    def __post_init__(self) -> None:
        if isinstance(self.labels, str):  # "all", or one name
            object.__setattr__(self, "labels", (self.labels,))
        check_fields(self)

    def read(self, source: str | os.PathLike[str]) -> LabelTract | SurfaceTract:
        """Return the tract in a file.

        Raises
        ------
        BozziniError
            As `bozzini.duct.shape_tract.open_tract`.
        """
        from ..anatomy.labels import override_organ
        from ..duct.shape_tract import open_tract

        part = self._shorten(self.part)
        tract = open_tract(
            source,
            labels="all" if self.labels == ("all",) else self.labels,
            part=tuple(part) if isinstance(part, list) else part,
            unit=self.unit,
            frame=self.frame,
            repair=self.repair,
        )
        return override_organ(tract, self.organ)  # type: ignore[arg-type]

    def describe(self, source: str | os.PathLike[str]) -> Json:
        """Return what the tract was read with as JSON-able values: enough to read it again."""
        from ..anatomy.read import hash_input

        return {
            "file": Path(source).name,
            "sha256": hash_input(source),
            "labels": list(self.labels) if self.labels else None,
            "part": self._shorten(self.part),
            "unit": self.unit,
            "frame": self.frame,
            "repair": self.repair,
        }

    @staticmethod
    def _shorten(parts: Sequence[str]) -> str | list[str] | None:
        """Return no part as None, one as itself, several as a list."""
        return (parts[0] if len(parts) == 1 else list(parts)) if parts else None


@dataclass(frozen=True, kw_only=True, eq=False)
class PathOptions(Shown):
    """The grid of the lumen, and where its centreline runs.

    Parameters
    ----------
    voxel, inflate : float
        See `bozzini.duct.build_field` [mm].
    start, end : (3,) float, int, str or None
        Ends of the centreline: a point in the world frame [mm], a label by number or name (the end
        lies in it), the name of a landmark or of an opening of the tract, ``"largest-opening"``, or
        None to find it. Where neither is given the organ of the tract decides which end is the
        entry; of an unknown organ both are tried, and the one is taken from which the scope gets
        farther, or with more clearance proved.
    via : sequence
        Places that the centreline passes, in this order; each as `start`.
    reverse : bool
        Begin at the other end.
    branch : str, optional
        Of a lumen that branches: the line is the way from the root, which is the start or else the
        widest end, to the end of this branch of `bozzini.duct.find_tree`.
    names : str, optional
        A file with names for its branches, see `bozzini.duct.tree_names.read_names`.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    voxel: float | None = quantity(
        "length",
        "Grid of the distance field (default: at most 1.5 mm of a volume, 1 mm of a surface).",
        default=None,
        low=VOXEL_MIN,
        example="1 mm",
    )
    inflate: float = quantity(
        "length",
        "Move the wall outwards, as insufflation does.",
        default=0.0,
        low=0.0,
        high=INFLATION_MAX,
        label="inflation",
    )
    start: ArrayLike | int | str | None = quantity(
        "end",
        "Where the centreline begins: a point, a label, a landmark, an opening or largest-opening.",
        default=None,
        example="[12 mm, -5 mm, 0 mm]",
    )
    end: ArrayLike | int | str | None = quantity(
        "end", "Where the centreline ends; as --start.", default=None, example="largest-opening"
    )
    via: Sequence[ArrayLike | int | str] = quantity(
        "end",
        "A place that the centreline passes; as --start; may be repeated.",
        default=(),
        example="[pylorus]",
    )
    reverse: bool = quantity("flag", "Enter at the other end.", default=False)
    branch: str | None = quantity(
        "text",
        "Go from the root of a tree to the end of this branch; 'bozzini tree' names them.",
        default=None,
        example="0.1.0",
    )
    names: str | None = quantity(
        "file",
        "Names for branches: labels of lobes or segments, or a table branch,name or x,y,z,name.",
        default=None,
        example="lobes.nii.gz",
    )

    def __post_init__(self) -> None:
        check_fields(self)
        if self.branch is not None:
            for name in ("end", "via", "reverse"):
                if getattr(self, name) not in (None, (), False):
                    raise InputError(f"branch cannot be used with {name}: it ends at the branch's")


@dataclass(frozen=True, kw_only=True, eq=False)
class LumenOptions:
    """The grid of a lumen that branches, and where its root is.

    Parameters
    ----------
    voxel, inflate, names
        As `PathOptions` has them.
    start
        The root, as `PathOptions` has a start; by default the widest end.
    """

    voxel: float | None = copy_field(PathOptions, "voxel")
    inflate: float = copy_field(PathOptions, "inflate")
    start: ArrayLike | int | str | None = copy_field(PathOptions, "start")
    names: str | None = copy_field(PathOptions, "names")

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def path(self) -> PathOptions:
        """The same as options of a path."""
        return PathOptions(
            voxel=self.voxel, inflate=self.inflate, start=self.start, names=self.names
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class TractFitOptions(PathOptions):
    """What shapes are fitted to a tract.

    Parameters
    ----------
    kind : {"cones", "cylinders", "superellipsoids"}
    max_error : float
        How far outside the wall the shapes may reach [mm].
    pieces : int, optional
        How many shapes at most.
    least_squares : bool
        Fit the wall from both sides, and not only from inside.
    """

    kind: str = quantity(
        "text", "What shapes stand for the lumen.", default="cones", words=FITTED_KINDS, option="as"
    )
    max_error: float = quantity(
        "length",
        "How far outside the wall the shapes may reach.",
        default=1.0,
        low=0.0,
        low_open=True,
        label="--max-error",
    )
    pieces: int | None = quantity(
        help="How many shapes at most (default: so many that no more clearance than --max-error is "
        "lost).",
        whole=True,
        default=None,
        low=1,
        high=500,
        label="--pieces",
    )
    least_squares: bool = quantity(
        "flag",
        "Fit the wall from both sides, and not only from inside: not for planning.",
        default=False,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class InsertionOptions(PathOptions):
    """How a scope is moved along the centreline of a tract, and what else is sought.

    Parameters
    ----------
    method, head_step, slip, angle_limit, route, advise
        See `bozzini.motion.plan_insertion`; a route may also be a key of `ROUTES`.
    soft_wall : float
        See `bozzini.motion.plan_with_soft_wall` [mm].
    label_error : float, optional
        How far the given wall may be from the true one [mm]: the result states whether the proof
        covers it.
    largest : bool
        Also find the largest diameter and the longest link that fit.
    compare : bool
        Also plan by every other method, for comparison.
    """

    method: str = quantity(
        "text",
        "The planner: best (of the next two and some between), tube (whole body, proved), follow "
        "(the leader), thesis (joints only).",
        default="best",
        words=tuple(PLANNERS),
    )
    head_step: float = copy_field(PlannerOptions, "head_step")
    slip: float = copy_field(PlannerOptions, "slip")
    angle_limit: float | None = copy_field(PlannerOptions, "angle_limit")
    route: Sequence[float] | str = quantity(
        "text",
        "Advance only, or also retract, or go in again.",
        default="in",
        words=tuple(ROUTES),
    )
    advise: bool = copy_field(PlannerOptions, "advise")
    soft_wall: float = quantity(
        "length",
        "The body may displace the wall by up to this; the report names the places.",
        default=0.0,
        low=0.0,
        high=100.0,
    )
    label_error: float | None = quantity(
        "length",
        "How far the given wall may be from the true one; exit code 1 if the proof does not cover "
        "it.",
        default=None,
        example="1 mm",
        low=0.0,
        high=100.0,
    )
    largest: bool = quantity(
        "flag", "Also find the largest diameter and longest link.", default=False
    )
    compare: bool = quantity("flag", "Also plan by the other methods, side by side.", default=False)

    def __post_init__(self) -> None:
        if not isinstance(self.route, str):
            object.__setattr__(self, "route", check_route(self.route))
        super().__post_init__()

    @property
    def fractions(self) -> tuple[float, ...]:
        """The route as fractions of the path."""
        return ROUTES[self.route] if isinstance(self.route, str) else tuple(self.route)

    @property
    def motion(self) -> PlannerOptions:
        """The options of the planner."""
        return PlannerOptions(
            head_step=self.head_step,
            slip=self.slip,
            angle_limit=self.angle_limit,
            route=self.fractions,
            advise=self.advise,
        )

    def check(self, scope: Scope) -> None:
        """Raise `InputError` for what is not legal for this scope in any tract."""
        from ..motion.planner import make_planner

        make_planner(self.method).check(scope, self.motion)


@contextmanager
def explain_scale(tract: LabelTract | SurfaceTract) -> Iterator[None]:
    """Add to an `InputError` that the tract's size is implausible, where that was found."""
    from ..errors import GeometryError, InputError

    try:
        yield
    except InputError as error:
        scale = [item.message for item in tract.findings if item.code == "scale"]
        if not scale:
            raise
        kind = GeometryError if isinstance(error, GeometryError) else InputError
        raise kind(f"{error}; {scale[0]}") from error


@dataclass(frozen=True, kw_only=True)
class ContactRiskOptions(Shown):
    """How far the wall may be from where it is said to be, and what is drawn of it.

    Parameters
    ----------
    sd : float, optional
        Standard deviation of the wall's place, along its normal [mm]. Of labels by default that of
        rounding to voxels alone: the largest side of a voxel over the root of 12.
    mean : float
        By how much the wall is farther inwards than it is said to be, on average [mm].
    correlation : float
        Errors at places that are h apart have the correlation ``exp(-h^2 / 2 correlation^2)``
        [mm].
    draws : int
        Random walls in which the plan is kept.
    seed : int
        Draw `i` depends on this and on `i` alone.
    replan : int
        The first so many of them are planned anew.
    diameters : tuple of float
        Other diameters of the same motion that the probability is given for [mm]; by default from
        0.6 to 1.2 times the scope's.

    Raises
    ------
    InputError
        If a number is not legal, or more is to be planned anew than is drawn.
    """

    sd: float | None = quantity(
        "length",
        "Standard deviation of the wall's place (default for labels: voxel / sqrt(12)).",
        default=None,
        low=0.0,
        low_open=True,
        high=20.0,
    )
    mean: float = quantity(
        "length", "How far inwards the wall is on average.", default=0.0, low=-20.0, high=20.0
    )
    correlation: float = quantity(
        "length", "Correlation length of that.", default=10.0, low=0.1, high=1e4
    )
    draws: int = quantity(
        help="Random walls in which the plan is kept.",
        default=10_000,
        low=1,
        high=10_000_000,
        whole=True,
    )
    seed: int = quantity(help="Of the draws.", default=1, low=0, high=2**31, whole=True)
    replan: int = quantity(
        help="Plan anew in the first so many of them.", default=0, low=0, high=100_000, whole=True
    )
    diameters: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self)
        for k, diameter in enumerate(self.diameters):
            check_number(
                f"diameters[{k}]", diameter, low=0.0, high=1000.0, low_open=True, unit="mm"
            )
        if self.replan > self.draws:
            raise InputError(
                f"replan is {self.replan}: it must be at most the number of draws, {self.draws}"
            )
