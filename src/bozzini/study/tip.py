"""How far errors of commands and parameters move a tip from where a model puts it.

That is no band of poses: what the model itself leaves out is not in it. Where rows were left out of
the fit of a robot, how far these were missed is stated beside it.

To first order the covariance of the tip is ``J C J^T``, with the covariance ``C`` of the errors and
the derivatives ``J`` of the tip, which are central differences of the model itself. The same errors
are drawn and computed exactly, so that it shows where the first order does not hold.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from ..checks import check_fields, check_number, check_path, list_quantities, quantity, show_apart
from ..continuum.calibration import RobotCalibration
from ..continuum.kinematics import ContinuumRobot
from ..continuum.measured import TIP
from ..continuum.predicting import find_band
from ..continuum.shape import Shape
from ..continuum.unknowns import FIELDS, RobotSetup, change_setup, parse_unknowns
from ..effector.effector import Effector
from ..effector.study import change_design, find_quantity
from ..errors import BozziniError, FileFormatError, InputError
from ..io.records import parse_json
from ..muscle import Muscle, MuscleModel
from ..muscle.ends import EndEffects
from ..muscle.files import MuscleFile
from ..muscle.prediction import find_spread, read_values
from ..muscle.problem import change_model, move_model
from ..numeric.arrays import Floats
from ..results import Json, Result, to_plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FindTips = Callable[[Floats], Floats]
"""Takes errors (n, k); gives the tips (n, 2 or 3) [mm], NaN where there is none."""

LIMIT = 0.1
"""Relative difference of the two covariances from which on the first order does not hold."""

STEP = 0.1
"""Step of the differences, in standard deviations."""

ELLIPSE_OF = "errors of commands and parameters alone: no band of poses"
"""What the ellipse is of, for people."""

BASE_FRAME = "base"
"""Of the robot or the end-effector, where it has no error: origin there, z along the backbone."""

STILL_MM = 1e-9
"""Motion that is none."""

_FLAT = 1e-9
"""Variance, as a share of the largest, below which a direction has none."""


@dataclass(frozen=True, kw_only=True)
class DrawOptions:
    """How errors are drawn.

    Parameters
    ----------
    draws : int
    seed : int
    level : float
        Share of the errors given that the ellipse holds; it is no band of poses.
    """

    draws: int = quantity(
        help="Draws that are computed exactly.", default=1024, low=64, high=1_000_000, whole=True
    )
    seed: int = quantity(help="Of the draws.", default=0, low=0, high=2**32 - 1, whole=True)
    level: float = quantity(
        help="Share of the errors given that the ellipse holds; it is no band of poses.",
        default=0.95,
        low=0.5,
        high=0.9999,
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Errors:
    """What is not known exactly: k numbers and the covariance of their errors.

    Parameters
    ----------
    names, units : tuple of str
    covariance : (k, k) array_like
    """

    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    covariance: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def __post_init__(self) -> None:
        count = len(self.names)
        matrix = np.asarray(self.covariance, dtype=np.float64)
        if matrix.shape != (count, count) or not np.isfinite(matrix).all():
            raise InputError(
                f"the covariance must be {count} rows of {count} finite numbers, as the names"
            )
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0.0):
            raise InputError("the covariance is not symmetric: its rows must be its columns")
        for name, variance in zip(self.names, np.diag(matrix), strict=True):
            check_number(f"the variance of {name}", float(variance), low=0.0)
        object.__setattr__(self, "covariance", 0.5 * (matrix + matrix.T))

    @classmethod
    def independent(cls, deviations: Mapping[str, float], units: Mapping[str, str]) -> Errors:
        """Return independent errors by their standard deviations."""
        names = tuple(deviations)
        spread = np.array([deviations[name] for name in names], dtype=np.float64)
        return cls(names=names, units=tuple(units[n] for n in names), covariance=np.diag(spread**2))

    def join(self, other: Errors) -> Errors:
        """Return both, independent of each other."""
        twice = next((name for name in other.names if name in self.names), None)
        if twice is not None:
            raise InputError(f"the error of '{twice}' is given more than once: give it once")
        count = len(self.names)
        whole = np.zeros((count + len(other.names),) * 2)
        whole[:count, :count], whole[count:, count:] = self.covariance, other.covariance
        return Errors(
            names=self.names + other.names, units=self.units + other.units, covariance=whole
        )

    @property
    def deviations(self) -> Floats:
        """Standard deviations (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def root(self) -> Floats:
        """A matrix ``L`` with ``L L^T`` the covariance, (k, k)."""
        values, vectors = np.linalg.eigh(self.covariance)
        if values[0] < -1e-6 * abs(values[-1]):
            raise InputError("the covariance is none: it has a negative eigenvalue")
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


@dataclass(frozen=True, kw_only=True, eq=False)
class TipError(Result):
    """How far errors move the tip: d is 2 for an end-effector, seen along its axis, else 3.

    The model's own error is not in it: measured poses are off by that as well.

    Attributes
    ----------
    tip : (d,) float
        Without errors [mm].
    errors : Errors
    jacobian : (d, k) float
        Derivatives of the tip by the errors.
    drawn : (n, d) float
        Tips of the draws that have one [mm].
    failed : int
        Draws without one.
    level : float
        Share of the errors given that the ellipse holds.
    frame : str
        Of all places and directions.
    left_out : float, optional
        Root mean square distance of rows left out of the fit of the robot [mm]; None if not known.
    within : (str, float, float), optional
        Kind of motion of this pose, the distance that predictions of the tip stay within there
        [mm], NaN if no row of the fit was of this kind, and what share of them does; None if not
        known.
    """

    tip: Floats
    errors: Errors
    jacobian: Floats
    drawn: Floats
    failed: int
    level: float
    frame: str = "as of the tips given"
    left_out: float | None = None
    within: tuple[str, float, float] | None = None

    @property
    def covariance(self) -> Floats:
        """To first order (d, d) [mm^2]."""
        return np.asarray(self.jacobian @ self.errors.covariance @ self.jacobian.T)

    @property
    def drawn_covariance(self) -> Floats:
        """Of the draws (d, d) [mm^2]."""
        return np.cov(self.drawn, rowvar=False)

    @property
    def residual(self) -> float:
        """Difference of the two covariances, relative to that of the draws."""
        scale = float(np.linalg.norm(self.drawn_covariance))
        return (
            float(np.linalg.norm(self.drawn_covariance - self.covariance)) / scale if scale else 0.0
        )

    @property
    def converged(self) -> bool:
        """Whether the first order holds: the covariances differ by at most `LIMIT`."""
        return self.residual <= LIMIT and not self.failed

    @property
    def reason(self) -> str:
        """Why not."""
        parts = []
        if self.residual > LIMIT:
            shown = show_apart(100.0 * self.residual, 100.0 * LIMIT, digits=0, form="f")
            parts.append(
                f"covariance to first order and of {len(self.drawn)} draws differ by "
                f"{shown[0]} %, more than {shown[1]} %: take the draws"
            )
        if self.failed:
            parts.append(f"{self.failed} draws have no shape")
        return "; ".join(parts)

    @property
    def axes(self) -> tuple[Floats, Floats]:
        """Semi-axes of one standard deviation (d,) [mm], largest first, and directions (d, d)."""
        values, vectors = np.linalg.eigh(self.covariance)
        return np.sqrt(np.maximum(values[::-1], 0.0)), vectors.T[::-1]

    @property
    def factor(self) -> float:
        """Semi-axes of the ellipse of `level`, in standard deviations."""
        from scipy.stats import chi2

        lengths = self.axes[0]
        rank = int((lengths**2 > _FLAT * lengths[0] ** 2).sum())
        return float(np.sqrt(chi2.ppf(self.level, max(rank, 1))))

    @property
    def coverage(self) -> float:
        """Share of the draws in the ellipse of `level`, seen in its own plane if it is flat."""
        lengths, ways = self.axes
        kept = lengths**2 > _FLAT * lengths[0] ** 2
        if not kept.any():
            return 1.0
        off = (self.drawn - self.tip) @ ways[kept].T / lengths[kept]
        return float(((off**2).sum(axis=1) <= self.factor**2).mean())

    @property
    def alone(self) -> Floats:
        """Distance that each error moves the tip by, one standard deviation (k,) [mm]."""
        return np.asarray(np.linalg.norm(self.jacobian, axis=0) * self.errors.deviations)

    def to_dict(self) -> Json:
        """Return the error as plain values."""
        lengths, ways = self.axes
        return to_plain({  # type: ignore[no-any-return]
            "frame": self.frame,
            "tip_mm": self.tip,
            "sd_mm": np.sqrt(np.diag(self.covariance)),
            "covariance_mm2": self.covariance,
            "semi_axes_mm": lengths,
            "directions": ways,
            "level": self.level,
            "ellipse_mm": self.factor * lengths,
            "ellipse_of": ELLIPSE_OF,
            "left_out_rms_mm": self.left_out,
            "prediction_band": None if self.within is None else dict(
                zip(("kind", "radius_mm", "level"), self.within, strict=True)
            ),
            "errors": {
                name: {"sd": float(sd), "unit": unit, "alone_mm": float(alone)}
                for name, unit, sd, alone in zip(
                    self.errors.names, self.errors.units, self.errors.deviations, self.alone,
                    strict=True,
                )
            },
            "draws": len(self.drawn),
            "failed": self.failed,
            "drawn_mean_mm": self.drawn.mean(axis=0),
            "drawn_covariance_mm2": self.drawn_covariance,
            "coverage": self.coverage,
            "converged": self.converged,
            "reason": self.reason,
            "residual": self.residual,
        })  # fmt: skip

    def list_columns(self) -> Mapping[str, object]:
        """Return the draws, a row each."""
        return {f"{axis}_mm": self.drawn[:, k] for k, axis in enumerate("xyz"[: len(self.tip)])}

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the draws and the ellipse, seen along z; return the axes."""
        return self._draw((0, 1), ax)

    def draw(self) -> Figure:
        """Return a figure, of three views in 3-D."""
        from ..plot.style import make_panels

        pairs = ((0, 1), (0, 2), (1, 2))[: 1 if len(self.tip) == 2 else 3]
        figure, panels = make_panels(1, len(pairs), size=(0.6 + 4.2 * len(pairs), 4.0))
        for pair, axes in zip(pairs, panels, strict=True):
            self._draw(pair, axes)
        return figure

    def _draw(self, plane: tuple[int, int], ax: Axes | None) -> Axes:
        from ..plot.study import draw_tip_error

        pair = list(plane)
        return draw_tip_error(
            self.drawn[:, pair],
            self.tip[pair],
            covariance=self.covariance[np.ix_(pair, pair)],
            level=self.level,
            names=["xyz"[k] for k in pair],
            ax=ax,
        )


def spread_tip(
    find_tips: FindTips, errors: Errors, *, options: DrawOptions | None = None
) -> TipError:
    """Return what errors of known covariance do to a tip.

    Parameters
    ----------
    find_tips : callable
        Takes errors (n, k); gives tips (n, d) [mm], NaN where there is none.
    errors : Errors
    options : DrawOptions, optional
        The draws are a scrambled Sobol sequence.

    Raises
    ------
    InputError
        If nothing is uncertain, or there is no tip without errors or a small one.
    """
    from scipy.special import ndtri
    from scipy.stats import qmc

    options = DrawOptions() if options is None else options
    spread, count = errors.deviations, len(errors.names)
    if not spread.any():
        raise InputError("nothing is uncertain: give a standard deviation or a fit")
    steps = np.diag(STEP * spread)
    near = find_tips(np.vstack([np.zeros((1, count)), steps, -steps]))
    if not np.isfinite(near).all():
        raise InputError("there is no shape, or none close by: the tip has no derivatives there")
    tip, ahead, behind = near[0], near[1 : count + 1], near[count + 1 :]
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.where(spread > 0.0, (ahead - behind).T / (2.0 * STEP * spread), 0.0)
    root = errors.root
    engine = qmc.Sobol(count, scramble=True, seed=np.random.default_rng(options.seed))
    whole = 1 << (options.draws - 1).bit_length()
    shares = engine.random(whole)[: options.draws]
    drawn = find_tips(ndtri(np.clip(shares, 1e-12, 1.0 - 1e-12)) @ root.T)
    good = np.isfinite(drawn).all(axis=1)
    if good.sum() < 3:
        raise InputError("the draws have no shape: the errors are too large")
    if max(np.abs(slopes * spread).max(), np.abs(drawn[good] - tip).max()) < STILL_MM:
        raise InputError("the errors do not move the tip")
    return TipError(
        tip=tip,
        errors=errors,
        jacobian=slopes,
        drawn=drawn[good],
        failed=int((~good).sum()),
        level=options.level,
    )


def _compute_each(find_tip: Callable[[Floats], Floats], errors: Floats, dim: int) -> Floats:
    """Return the tips of errors (n, k) one by one, NaN where there is none."""
    tips = np.full((len(errors), dim), np.nan)
    for i, row in enumerate(errors):
        try:
            tips[i] = find_tip(row)
        except BozziniError:
            continue
    return tips


def effector_tip_error(
    effector: Effector,
    pressures: Mapping[str, float],
    *,
    pressure_sd: float = 0.0,
    parameter_sd: Mapping[str, float] | None = None,
    fit: MuscleFile | None = None,
    options: DrawOptions | None = None,
) -> TipError:
    """Return how far the tip of an end-effector may be from its place, seen along its axis.

    Parameters
    ----------
    effector : Effector
    pressures : mapping of str to float
        [MPa].
    pressure_sd : float
        Standard deviation of each pressure that is not 0 [MPa]. Draws below 0 and above the
        pressure limit of the design are taken as these.
    parameter_sd : mapping of str to float, optional
        Standard deviations by the names of `bozzini.effector.change_design`, the same error for all
        muscles, such as ``muscle.modulus``.
    fit : MuscleFile, optional
        A fit of the muscles, whose model they then have, and its covariance. What all specimens
        share has one error for all muscles; what each has of its own, one for each, of which the
        error of the specimens' mean is common to all.
    options : DrawOptions, optional

    Raises
    ------
    InputError
        If a value is not legal, or nothing is uncertain.
    """
    check_number("pressure_sd", pressure_sd, low=0.0, unit="MPa")
    given = effector.take_pressures(pressures)
    limit = max(effector.design.pressure_limit, float(given.max()))
    names = [name for name, value in zip(effector.design.names, given, strict=True) if value > 0.0]
    errors = Errors.independent(
        {f"pressure {name}": pressure_sd for name in names if pressure_sd},
        {f"pressure {name}": "MPa" for name in names},
    )
    columns = [effector.design.index(name) for name in names if pressure_sd]
    own, units = dict(parameter_sd or {}), {}
    for name, value in own.items():
        known = find_quantity(name)
        if known is None or known.whole:
            raise InputError(f"'{name}' has no standard deviation: give one such as offset")
        units[name] = known.unit
        check_number(f"standard deviation of {name}", value, low=0.0, unit=known.unit)
    errors = errors.join(Errors.independent(own, units))
    build = _Muscles(effector, fit)
    errors = errors.join(build.errors)

    def find_pressures(rows: Floats) -> Floats:
        moved = np.repeat(given[None], len(rows), axis=0)
        moved[:, columns] += rows[:, : len(columns)]
        return np.clip(moved, 0.0, limit)

    middle = len(columns) + len(own)

    def find_tip(row: Floats) -> Floats:
        changes = dict(zip(own, row[len(columns) : middle], strict=True))
        return build(changes, row[middle:]).forward(find_pressures(row[None])[0]).tip[:2]

    exact = build({}, np.zeros(len(build.errors.names)))

    def find_tips(rows: Floats) -> Floats:
        if rows[:, len(columns) :].any():
            return _compute_each(find_tip, rows, 2)
        return exact.forward(find_pressures(rows)).tip[:, :2]

    return replace(spread_tip(find_tips, errors, options=options), frame=BASE_FRAME)


class _Muscles:
    """An end-effector with other parameters, and the errors that a fit of its muscles has."""

    def __init__(self, effector: Effector, fit: MuscleFile | None) -> None:
        self.effector, self.fit = effector, fit
        self.errors = Errors()
        self.bases: list[MuscleModel] = []
        if fit is None:
            return
        known = fit.fit
        if known is None or not known.names:
            raise InputError(
                "the muscle file holds no fit: write one by 'bozzini muscle fit --out'"
            )
        base = fit.build()
        self.bases = [
            move_model(base, fit.muscle.replace(length=placed.muscle.length))
            for placed in effector.design.muscles
        ]
        self.values = [read_values(base, known.names) for base in self.bases]
        # A column of each muscle takes what is shared, or its own.
        labels: list[tuple[int, str]] = []
        columns: list[list[int]] = []
        for name in effector.design.names:
            columns.append([])
            for place, parameter in enumerate(known.names):
                label = (place, name if parameter in known.each else "")
                if label not in labels:
                    labels.append(label)
                columns[-1].append(labels.index(label))
        self.columns = columns
        matrix = np.array(known.covariance)
        units = _list_units(fit)
        places = [place for place, _ in labels]
        owners = [name for _, name in labels]
        # Specimens differ by errors of their own about a mean, and its error is that of all.
        other = np.array([[a != b and bool(a) and bool(b) for b in owners] for a in owners])
        apart = other * np.diag(find_spread(known)[0])[np.ix_(places, places)]
        self.errors = Errors(
            names=tuple(
                f"{known.names[place]}[{name}]" if name else known.names[place]
                for place, name in labels
            ),
            units=tuple(units.get(known.names[place], "") for place in places),
            covariance=matrix[np.ix_(places, places)] - apart,
        )

    def __call__(self, changes: Mapping[str, float], errors: Floats) -> Effector:
        design = self.effector.design
        if changes:
            moved = {name: self._read(name) + value for name, value in changes.items()}
            design = change_design(design, moved)
        if self.fit is None:
            return replace(self.effector, design=design)
        models = iter([
            change_model(base, {
                name: value + float(errors[column])
                for (name, value), column in zip(values.items(), columns, strict=True)
            })
            for base, values, columns in zip(self.bases, self.values, self.columns, strict=True)
        ])  # fmt: skip
        return replace(self.effector, design=design, model=lambda _: next(models))

    def _read(self, name: str) -> float:
        design = self.effector.design
        if name.startswith("muscle."):
            return float(getattr(design.muscles[0].muscle, name.removeprefix("muscle.")))
        return float(getattr(design, "backbone_length" if name == "length" else name))


def _list_units(fit: MuscleFile) -> dict[str, str]:
    known = {**list_quantities(Muscle), **list_quantities(EndEffects)}
    return {name: item.unit for name, item in known.items()}


def robot_tip_error(
    robot: ContinuumRobot,
    commands: Mapping[str, float],
    *,
    held: Literal["displacements", "tensions"] = "displacements",
    command_sd: float = 0.0,
    parameters: Errors | None = None,
    options: DrawOptions | None = None,
) -> TipError:
    """Return how far the tip of a tendon robot may be from its place.

    Parameters
    ----------
    robot : ContinuumRobot
        A calibrated one is modelled as it was fitted.
    commands : mapping of str to float
        Displacements [mm] or tensions [N] of tendons; displacements that are left out follow.
    held : {"displacements", "tensions"}
        Places are in the frame of the robot's base where that has no error.
    command_sd : float
        Standard deviation of each command that is given [mm] or [N]. Draws of a tension below 0,
        and of a number beyond its legal range, are taken as the end of the range.
    parameters : Errors, optional
        Of the names of `bozzini continuum fit`, such as ``sections.1.bending_stiffness``: what is
        changed by a factor has the error of its logarithm. See `read_robot_errors`.
    options : DrawOptions, optional

    Raises
    ------
    InputError
        If a value is not legal, or nothing is uncertain.
    """
    pulled = held == "tensions"
    unit = "N" if pulled else "mm"
    check_number("command_sd", command_sd, low=0.0, unit=unit)
    order = robot.order_tensions if pulled else robot.order_displacements
    given = np.asarray(order(dict(commands)), dtype=np.float64)
    names = list(commands) if command_sd else []
    columns = [robot.tendon_names.index(name) for name in names]
    labels = [f"{'tension' if pulled else 'displacement'} {name}" for name in names]
    errors = Errors.independent(dict.fromkeys(labels, command_sd), dict.fromkeys(labels, unit))
    own = Errors() if parameters is None else parameters
    errors = errors.join(own)
    setup = RobotSetup.of(robot)
    unknowns = parse_unknowns(own.names, setup) if own.names else ()
    if len(unknowns) != len(own.names):
        raise InputError(f"errors of {', '.join(own.names)}: give each number by its own name")

    def find_tips_of(one: ContinuumRobot, rows: Floats) -> Floats:
        moved = np.repeat(given[None], len(rows), axis=0)
        moved[:, columns] += rows[:, : len(columns)]
        turned = np.linalg.solve(robot.base_frame, one.base_frame)
        if pulled:
            shape = one.forward(tensions=np.maximum(moved, 0.0))
        else:
            shape = one.forward(moved)
        tips = shape.tip @ turned[:3, :3].T + turned[:3, 3]
        return np.where(np.asarray(shape.converged)[:, None], tips, np.nan)

    limits = np.array([one.limit(setup)[:2] for one in unknowns]).reshape(-1, 2)

    def find_tip(row: Floats) -> Floats:
        moved = change_setup(setup, unknowns, np.clip(row[len(columns) :], *limits.T))
        zeros = dict(zip(robot.tendon_names, moved.zeros, strict=False))
        known = robot.calibration or RobotCalibration(command="tension" if pulled else
                                                      "displacement")  # fmt: skip
        known = replace(known, zeros=zeros, scale=moved.scale, backlash=moved.backlash)
        other = replace(moved.robot, calibration=known)
        return find_tips_of(other, row[None])[0]  # type: ignore[no-any-return]

    def find_tips(rows: Floats) -> Floats:
        if rows[:, len(columns) :].any():
            return _compute_each(find_tip, rows, 3)
        return find_tips_of(robot, rows)

    known = robot.calibration
    alike = known is not None and known.command == held.removesuffix("s")
    left_out = known.validation_rms if known is not None and alike else 0.0
    found = spread_tip(find_tips, errors, options=options)
    one = given[None]
    shape = robot.forward(tensions=np.maximum(one, 0.0)) if pulled else robot.forward(one)
    within = _find_band(robot, shape) if alike else None
    return replace(found, frame=BASE_FRAME, left_out=left_out or None, within=within)


def _find_band(robot: ContinuumRobot, shape: Shape) -> tuple[str, float, float] | None:
    """Return kind of motion, radius and level of the band of the fit at a shape (1,).

    The radius is NaN where no row of the fit was of this kind.
    """
    known = robot.calibration
    found = find_band(robot, shape, [TIP])
    if found is None or known is None or known.band is None or TIP not in known.band.markers:
        return None
    return str(found.kinds[0]), float(found.radii[0, 0]), found.level


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotFitFile:
    """What ``bozzini continuum fit --json`` writes, as far as errors of the tip ask for it.

    Parameters
    ----------
    path : Path
    errors : Errors
        Of the numbers that were fitted.
    values : mapping of str to float
        The numbers.
    robot : ContinuumRobot, optional
        With these numbers; None if the file has none.
    """

    path: Path
    errors: Errors
    values: Mapping[str, float]
    robot: ContinuumRobot | None

    def take_robot(self, given: ContinuumRobot) -> tuple[ContinuumRobot, tuple[str, ...]]:
        """Return the robot with the numbers of the fit, and notes: the one given, if it has them.

        Raises
        ------
        InputError
            If it has not, and the file has no robot of these tendons.
        """
        known = {} if given.calibration is None else given.calibration.values
        if known.keys() == self.values.keys() and all(
            math.isclose(known[name], value, rel_tol=1e-6, abs_tol=1e-12)
            for name, value in self.values.items()
        ):
            return given, ()
        if self.robot is None or self.robot.tendon_names != given.tendon_names:
            raise InputError(
                f"robot '{given.name}' does not have the numbers of {self.path.name}: give the "
                "robot that 'bozzini continuum fit --out' wrote"
            )
        note = f"the numbers are those of {self.path.name}, not of robot '{given.name}' as given"
        return self.robot, (note,)


def read_robot_errors(path: str | os.PathLike[str]) -> Errors:
    """Return the errors of a fit of a robot, as `read_robot_fit` does."""
    return read_robot_fit(path).errors


def read_robot_fit(path: str | os.PathLike[str]) -> RobotFitFile:
    """Return a fit of a robot, from what ``bozzini continuum fit --json`` writes.

    Raises
    ------
    FileFormatError
        If it is no such file.
    InputError
        If the data did not determine a number.
    """
    source = check_path("fit", path)
    try:
        found = cast(Json, parse_json(source.read_text(encoding="utf-8")))
        estimates, correlations = found["estimates"], np.array(found["correlations"], dtype=float)
        names = tuple(str(name) for name in estimates)
        rows = [(one["value"], one["unit"], one["standard_error"]) for one in estimates.values()]
        robot = found.get("robot")
        robot = None if robot is None else ContinuumRobot.from_dict(robot)
    except OSError as error:
        raise FileFormatError(f"cannot read {source}: {error.strerror}") from None
    except InputError as error:
        raise FileFormatError(f"{source}: {error}") from None
    except (ValueError, TypeError, KeyError, AttributeError):
        raise FileFormatError(
            f"{source} is no fit of a robot: write one by 'bozzini continuum fit ... --json'"
        ) from None
    if correlations.shape != (len(names),) * 2:
        raise FileFormatError(f"{source}: correlations must be {len(names)} rows of {len(names)}")
    spread = np.zeros(len(names))
    for k, (name, (value, _, deviation)) in enumerate(zip(names, rows, strict=True)):
        if not isinstance(value, (int, float)) or not isinstance(deviation, (int, float)):
            raise InputError(f"{source}: {name} is not determined by the data: fit without it")
        spread[k] = deviation / abs(value) if is_factor(name) else deviation
    errors = Errors(
        names=names,
        units=tuple("relative" if is_factor(name) else str(unit) for name, (_, unit, _) in
                    zip(names, rows, strict=True)),
        covariance=spread[:, None] * correlations * spread,
    )  # fmt: skip
    values = {name: float(value) for name, (value, _, _) in zip(names, rows, strict=True)}
    return RobotFitFile(path=source, errors=errors, values=values, robot=robot)


def is_factor(name: str) -> bool:
    """Whether a number of a robot is changed by a factor, so that its error is relative."""
    last = name.rpartition(".")[2]
    known = next((fields[last] for fields in FIELDS.values() if last in fields), None)
    return known is not None and known.change == "factor"
