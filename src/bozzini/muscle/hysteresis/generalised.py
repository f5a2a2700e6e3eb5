"""Plays between two curves without memory: loops that are not symmetric, with a closed inverse."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...checks import check_array, check_integer, check_number, check_range
from ...errors import InputError
from ...numeric.arrays import Floats
from ...numeric.least_squares import LeastSquares, explain_end
from ...results import Shown
from .operator import (
    EVALUATIONS,
    LIMIT,
    HysteresisFit,
    HysteresisState,
    InvertibleOperator,
    LinearFit,
    LoopOptions,
    Loops,
    fit_linear,
    numbers,
    take_fields,
    take_increasing,
)
from .prandtl_ishlinskii import PrandtlIshlinskii, choose_thresholds, trace_symmetric_plays

_LEAST_WEIGHT = 1e-3  # of the play of width 0, so that there is an inverse
_LEAST_SLOPE = 1e-3  # of the output curve that a fit tries, in mean slopes of the loops


@dataclass(frozen=True)
class MonotoneCurve(Shown):
    """An increasing curve of straight pieces, the first and last of which go on.

    Parameters
    ----------
    inputs, outputs : sequence of float
        Corners, 2 or more, both increasing.

    Raises
    ------
    InputError
        If they are no such numbers, or not as many.
    """

    inputs: tuple[float, ...] = numbers(increasing=True, low=-LIMIT, default=(0.0, 1.0))
    outputs: tuple[float, ...] = numbers(
        increasing=True, low=-LIMIT, like="inputs", default=(0.0, 1.0)
    )

    def __post_init__(self) -> None:
        take_fields(self)
        if len(self.inputs) < 2:
            raise InputError(f"inputs has {len(self.inputs)} number(s): it must have 2 or more")

    def apply(self, input_: ArrayLike) -> Floats:
        """Return the outputs, shape (...), at inputs (...)."""
        inputs = check_array("input", input_)
        check_range("input", inputs, -LIMIT, LIMIT)
        x, y = np.array(self.inputs), np.array(self.outputs)
        piece = np.searchsorted(x[1:-1], inputs, side="right")
        return np.asarray(y[piece] + (np.diff(y) / np.diff(x))[piece] * (inputs - x[piece]))

    def invert(self) -> MonotoneCurve:
        """Return the inverse."""
        return MonotoneCurve(self.outputs, self.inputs)


@dataclass(frozen=True)
class GeneralisedPrandtlIshlinskii(InvertibleOperator):
    """Plays between an input curve and an output curve, both increasing and without memory.

    The output is ``S(sum of w_i H_i[g(P)])``, with plays as in `PrandtlIshlinskii`. The curve S
    after the plays is the modified operator of K. Kuhnen, Modeling, identification and compensation
    of complex hysteretic nonlinearities, European Journal of Control 9, 2003; the curve g before
    them is the envelope of the generalised one of M. Al Janaideh, S. Rakheja and C.-Y. Su, An
    analytical generalized Prandtl-Ishlinskii model inversion, IEEE/ASME Transactions on
    Mechatronics 16, 2011, with one envelope for both ways. Loops need not be symmetric; they close,
    and are as wide as the curves are steep. With plays that have an inverse the whole has one, of
    the same form.

    Parameters
    ----------
    plays : PrandtlIshlinskii
        The plays.
    output : MonotoneCurve
        S; the identity by default.
    input : MonotoneCurve
        g; the identity by default.

    Raises
    ------
    InputError
        If they are not of these types.
    """

    plays: PrandtlIshlinskii
    output: MonotoneCurve = field(default_factory=MonotoneCurve)
    input: MonotoneCurve = field(default_factory=MonotoneCurve)

    def __post_init__(self) -> None:
        for name, kind in (
            ("plays", PrandtlIshlinskii),
            ("output", MonotoneCurve),
            ("input", MonotoneCurve),
        ):
            item = getattr(self, name)
            if not isinstance(item, kind):
                raise InputError(f"{name} is a {type(item).__name__}: it must be a {kind.__name__}")

    @property
    def memory_size(self) -> int:
        """How many plays there are."""
        return self.plays.memory_size

    @property
    def rest_input(self) -> float:
        """Input at rest."""
        return float(self.input.invert().apply(self.plays.origin))

    def invert(self) -> GeneralisedPrandtlIshlinskii:
        """Return the inverse: the inverse plays between the inverse curves, changed over.

        Raises
        ------
        InputError
            If the plays have none; see `PrandtlIshlinskii.invert`.
        """
        return GeneralisedPrandtlIshlinskii(
            self.plays.invert(), output=self.input.invert(), input=self.output.invert()
        )

    def invert_state(self, state: HysteresisState) -> HysteresisState:
        """Return the state of `invert` that belongs to a state of this operator.

        Raises
        ------
        InputError
            As `PrandtlIshlinskii.invert_state` does.
        """
        state = self._take_state(state, state.last.shape)
        inner = self.plays.invert_state(HysteresisState(self.input.apply(state.last), state.memory))
        return HysteresisState(self.output.apply(inner.last), inner.memory)

    def invert_history(
        self,
        response: ArrayLike,
        *,
        between: tuple[float, float],
        initial: HysteresisState | None = None,
        clip: bool = False,
    ) -> Floats:
        """Return the inputs that give these outputs, found through the inverse curves."""
        low, high = self.input.apply(between).tolist()
        if initial is not None:
            initial = HysteresisState(self.input.apply(initial.last), initial.memory)
        inner = self.plays.invert_history(
            self.output.invert().apply(response), between=(low, high), initial=initial, clip=clip
        )
        return self.input.invert().apply(inner)

    @classmethod
    def identify(
        cls,
        history: ArrayLike,
        response: ArrayLike,
        *,
        thresholds: Sequence[float] | None = None,
        count: int = 10,
        pieces: int = 10,
        options: LoopOptions | None = None,
    ) -> HysteresisFit[GeneralisedPrandtlIshlinskii]:
        """Fit the plays and the output curve to measured loops; the input curve is the identity.

        Weights are 0 or more and the output curve increases, so that what is found increases with
        its input and has an inverse. A search (`scipy.optimize.least_squares`, with derivatives)
        begins at the best plays with a straight curve. The plays are scaled so that their output at
        the largest input, from rest, is that input.

        History, response and options are those of all operators, see `Operator`.

        Parameters
        ----------
        thresholds : sequence of float, optional
            Thresholds; else `count` of them, evenly from 0 to below half the span of the inputs.
        count : int
            How many, 1 to 200.
        pieces : int
            Straight pieces of the curve, evenly over the outputs of the plays, 1 to 50.
        """
        loops = Loops.take(history, response, options)
        pieces = check_integer("pieces", pieces, low=1, high=50)
        given = choose_thresholds(loops.fitted_inputs, thresholds, count, counts=(1, 200))
        every = take_increasing("thresholds", given)
        check_number("thresholds[0]", every[0], low=0.0, high=0.0)
        top = float(np.abs(loops.inputs).max())
        plays = trace_symmetric_plays(loops.inputs, every)
        moving = ~loops.find_still(plays)
        plays, rungs = plays[..., moving], np.array(every)[moving]
        first = loops.fit(plays, names=[""] * len(rungs), judge=False)
        virgin = np.maximum(top - rungs, 0.0)
        weights = np.maximum(first.values, _LEAST_WEIGHT * max(*first.values, 1e-12))
        scale = float(virgin @ weights) / top
        weights = weights / scale
        inner = plays @ weights
        # The first piece goes on to the output at rest, where there may be no samples.
        corners = np.linspace(float(inner[:, loops.skip :].min()), top, pieces + 1)
        corners[0] = min(corners[0], 0.0)
        span = float(np.ptp(loops.response[..., loops.skip :])) or 1.0
        search = _Search(loops, plays, corners, span)
        weights, slopes, found = search.run(weights, scale)
        scale = float(virgin @ weights) / top
        weights, corners, slopes = weights / scale, corners / scale, slopes * scale
        heights = np.append(0.0, np.cumsum(slopes * np.diff(corners)))
        heights += loops.find_offset(found) - np.interp(0.0, corners, heights)
        whole = np.zeros(len(every))
        whole[moving] = weights
        operator = cls(
            PrandtlIshlinskii(every, tuple(whole.tolist())),
            MonotoneCurve(tuple(corners.tolist()), tuple(heights.tolist())),
        )
        still = tuple(f"plays.weights[{i}]" for i in np.flatnonzero(~moving))
        return loops.report(operator, found, lost=still)

    def _advance(self, inputs: Floats, last: Floats, memory: Floats) -> Floats:
        return self.output.apply(self.plays._advance(self.input.apply(inputs), last, memory))


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for weights and slopes; a point has both, and the factors of what is free."""

    loops: Loops
    plays: Floats
    corners: Floats
    span: float

    def run(self, weights: Floats, scale: float) -> tuple[Floats, Floats, LinearFit]:
        """Return weights, slopes of the pieces and the fit."""
        loops, span = self.loops, self.span
        columns, free = loops.pick(self.plays), loops.pick_free()
        root, target = loops.pick(np.ones((*loops.inputs.shape, 1))), loops.target
        count, last = len(weights), len(weights) + len(self.corners) - 1
        bare = columns / np.where(root > 0.0, root, 1.0)
        pieces = np.diff(self.corners)

        def cover(inner: Floats) -> tuple[Floats, NDArray[np.intp]]:
            """How much of each piece lies between 0 and the plays' outputs, and their piece."""
            piece = np.searchsorted(self.corners[1:-1], inner, side="right")
            reach = np.clip(inner[:, None] - self.corners[:-1], 0.0, pieces)
            rows = np.arange(len(inner))
            reach[rows, piece] = inner - self.corners[piece]
            return reach - np.clip(-self.corners[:-1], 0.0, pieces), piece

        def miss(point: Floats) -> Floats:
            reach, _ = cover(bare @ point[:count])
            model = root[:, 0] * (reach @ point[count:last]) + free @ point[last:]
            return np.asarray((model - target) / span)

        def derive(point: Floats) -> Floats:
            reach, piece = cover(bare @ point[:count])
            slopes = point[count:last][piece]
            return np.hstack([slopes[:, None] * columns, root * reach, free]) / span

        least = _LEAST_SLOPE * span / float(np.ptp(loops.inputs))
        reach, _ = cover(bare @ weights)
        curve = _fit_curve(root * reach, free, target, least)
        begin = np.concatenate([weights, np.maximum(curve.values, 1.001 * least), curve.free])
        low = np.concatenate(
            [
                [_LEAST_WEIGHT],
                np.zeros(count - 1),
                np.full(last - count, least),
                np.full(free.shape[1], -np.inf),
            ]
        )
        begin[:last] = np.maximum(begin[:last], low[:last] + 1e-9)
        search = LeastSquares(
            misfit=miss, slope=derive, bounds=(low, np.inf), scale="jac",
            xtol=1e-8, ftol=1e-7, gtol=1e-12,
        )  # fmt: skip
        best = search.descend(begin, evaluations=EVALUATIONS)
        stopped = "" if best.converged else explain_end(best.status, EVALUATIONS)
        weights = np.where(best.point[:count] > 1e-9, best.point[:count], 0.0)
        reach, _ = cover(bare @ weights)
        end = _fit_curve(root * reach, free, target, least)
        found = replace(end, converged=not stopped, reason=stopped, evaluations=best.evaluations)
        return weights, np.array(found.values), found


def _fit_curve(reach: Floats, free: Floats, target: Floats, least: float) -> LinearFit:
    """Fit the slopes of the pieces, which are linear once the plays are known."""
    names = [f"output.outputs[{i + 1}]" for i in range(reach.shape[1])]
    return fit_linear(reach, target, names=names, limits=(least, np.inf), free=free)
