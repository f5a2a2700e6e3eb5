"""Jobs on a head by itself: its sizes and reach, what collides, what the camera sees."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_integer, quantity
from ..numeric.arrays import Floats
from ..progress import Progress, no_progress
from ..results import (
    ClosedForm,
    Json,
    ReasonedResult,
    Result,
    format_rows,
    list_row,
    measured,
    rows_of,
    tabulated,
    take_axes,
)
from ..task import Task
from .design import FITS, Head, PlacedEffector, read_head
from .shape import ROUND_OFF, list_bodies, list_pairs, measure_gaps, name_effector, see_tips

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PAIR_SAMPLES = 80  # poses of each of two end-effectors that are looked at together


def head_field() -> str:
    """Return the input of a head's file."""
    help = "The head (.yaml, .json); without it that of the thesis's concept."
    return quantity("file", help, default=None, example="head.yaml")  # type: ignore[no-any-return]


class ResultOfRows(Result):
    """A result with `rows`, which stand in its dictionary with their units."""

    rows: tuple[object, ...]

    def to_dict(self) -> Json:
        """Return the result as plain values, a dictionary for each row."""
        return {**super().to_dict(), "rows": [list_row(row) for row in self.rows]}


@dataclass(frozen=True, kw_only=True)
class InstrumentRow:
    """What an end-effector does with its instrument fitted in one way.

    Parameters
    ----------
    effector : int
        From 1.
    fit : str
    rigidity : float
        ``EI`` of section and instrument [N mm^2].
    holder, tip : float
        How far sideways the muscle that bends it most takes the ends of holder and instrument [mm].
    lean : float
        Angle of the instrument from the axis there [rad].
    around : float
        How far the tip gets in every direction [mm].
    """

    effector: int = tabulated()
    fit: str = tabulated()
    rigidity: float = tabulated("N mm^2")
    holder: float = tabulated("mm")
    tip: float = tabulated("mm")
    lean: float = tabulated("rad")
    around: float = tabulated("mm")


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadLayout(ResultOfRows, ClosedForm):
    """Sizes of a head, and what its end-effectors do with each fit of their instruments.

    Attributes
    ----------
    head : Head
    covered_length, free_length : float
        From the face to the cap's front, and to the farthest end with all straight [mm].
    lens_height, lens_offset : float
        Where the lens is, along the axis and from it [mm].
    look_down : float
        Angle of the camera's axis from the head's [rad], towards the head's axis.
    arm_strain : float
        When it lies straight.
    cap_pull : float
        Of the cables [N].
    rows : tuple of InstrumentRow
    """

    head: Head
    covered_length: float = measured("mm")
    free_length: float = measured("mm")
    lens_height: float = measured("mm")
    lens_offset: float = measured("mm")
    look_down: float = measured("rad")
    arm_strain: float = measured("")
    cap_pull: float = measured("N")
    rows: tuple[InstrumentRow, ...] = rows_of(InstrumentRow)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the head from the side, and return the axes."""
        return self.head.plot(ax)


def lay_out(head: Head) -> HeadLayout:
    """Return sizes of a head, and what its instruments do to its end-effectors."""
    _, (_, lens) = head.lay_arm()
    camera = head.camera
    rows = [
        _measure_fit(k + 1, replace(placed, instrument=replace(placed.instrument, fit=fit)))
        for k, placed in enumerate(head.effectors)
        for fit in FITS
    ]
    return HeadLayout(
        head=head,
        covered_length=head.cap.length,
        free_length=head.length,
        lens_height=float(lens[2]),
        lens_offset=float(np.hypot(*lens[:2])),
        look_down=camera.fall_angle - camera.rise_angle,
        arm_strain=camera.strain,
        cap_pull=head.cap.pull,
        rows=tuple(rows),
    )


def _measure_fit(number: int, placed: PlacedEffector) -> InstrumentRow:
    space = placed.effector.workspace(directions=360, samples=1)
    most = np.array([[float(space.reach.amplitudes.max()), 0.0], [space.inner_radius, 0.0]])
    poses = placed.shape(most)
    off = np.hypot(*(poses.tip - placed.place)[:, :2].T)
    return InstrumentRow(
        effector=number,
        fit=placed.instrument.fit,
        rigidity=placed.effector.design.rigidity,
        holder=float(np.hypot(*(poses.holder_tip - placed.place)[0, :2])),
        tip=float(off[0]),
        lean=float(np.arccos(poses.direction[0, 2])),
        around=float(off[1]),
    )


@dataclass(frozen=True, kw_only=True)
class HeadShow(Task):
    """Show a distal head: its sizes, and its reach with and without instruments.

    For each end-effector: the section's rigidity with a separate catheter, with an integrated one,
    and with none; how far its strongest muscle alone takes holder and tip sideways at the pressure
    limit; and how far the tip gets in every direction.

    Exit code 0: done; 2: bad input.
    """

    name = "show"
    group = "head"
    result = HeadLayout

    head: str | None = head_field()

    def run(self, progress: Progress = no_progress) -> HeadLayout:
        """Return sizes and reach."""
        return lay_out(read_head(self.head))

    def describe(self, found: HeadLayout) -> str:
        """Return the sizes, and the fits as a table."""
        head = ["end-effector", "catheter", "EI [N mm^2]", "holder [mm]", "tip [mm]", "lean [deg]",
                "every way [mm]"]  # fmt: skip
        rows = [
            [str(row.effector), row.fit, f"{row.rigidity:.0f}", f"{row.holder:.1f}",
             f"{row.tip:.1f}", f"{math.degrees(row.lean):.1f}", f"{row.around:.1f}"]
            for row in found.rows
        ]  # fmt: skip
        return "\n".join(
            [
                f"{found.head.diameter:g} mm across, {found.covered_length:g} mm under the cap, "
                f"{found.free_length:g} mm long when it is free",
                f"The lens is {found.lens_height:.1f} mm ahead of the face and "
                f"{found.lens_offset:.1f} mm off the axis, and looks "
                f"{math.degrees(found.look_down):.0f} deg towards it; the arm strains by "
                f"{100.0 * found.arm_strain:.1f} % when it lies straight",
                f"Cables hold the cap back with {found.cap_pull:.2f} N, without friction",
                format_rows(head, rows),
            ]
        )


@dataclass(frozen=True, kw_only=True)
class GapRow:
    """The gap between two bodies.

    Parameters
    ----------
    state : str
        Under the cap; free, without pressure; or free, in any pose.
    bodies : str
    gap : float
        The least [mm]; negative where they overlap.
    share_free : float
        Share of the poses without overlap.
    """

    state: str = tabulated()
    bodies: str = tabulated()
    gap: float = tabulated("mm")
    share_free: float = tabulated()


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadCheck(ResultOfRows, ReasonedResult):
    """What of a head collides.

    Attributes
    ----------
    rows : tuple of GapRow
    least_gap : float
        Under the cap and at rest [mm].
    share_free : float
        Share of the end-effectors' poses in which nothing touches, the least of all pairs.
    reason : str
        What does not fit under the cap, or touches at rest; empty if nothing.
    """

    rows: tuple[GapRow, ...] = rows_of(GapRow)
    least_gap: float = measured("mm")
    share_free: float = measured("")
    reason: str

    @property
    def residual(self) -> float:
        """By how much bodies overlap under the cap or at rest [mm]."""
        return max(0.0, -self.least_gap)


def check_head(head: Head, *, samples: int = 400) -> HeadCheck:
    """Return what of a head collides: under the cap, free at rest, and in all poses.

    Parameters
    ----------
    head : Head
    samples : int
        About how many poses of each end-effector are looked at; beside another one 80.

    Raises
    ------
    InputError
        If `samples` is outside [10, 100000].
    """
    samples = check_integer("samples", samples, low=10, high=100_000)
    rows = _check_stowed(head)
    rest = [placed.shape(np.zeros((1, 2))) for placed in head.effectors]
    few, many = (
        [placed.shape(placed.list_bends(count)) for placed in head.effectors]
        for count in (_PAIR_SAMPLES, samples)
    )
    for state, poses in (("free, at rest", rest), ("free, any pose", many)):
        bodies, fewer = list_bodies(head, poses), list_bodies(head, few)
        for one, other in list_pairs(head):
            known = bodies if one == "camera" or poses is rest else fewer
            gaps = measure_gaps(known[one], known[other])
            rows.append(
                GapRow(
                    state=state,
                    bodies=f"{one} and {other}",
                    gap=float(gaps.min()),
                    share_free=float((gaps >= -ROUND_OFF).mean()),
                )
            )
    fixed = [row for row in rows if row.state != "free, any pose"]
    worst = min(fixed, key=lambda row: row.gap)
    reason, camera = "", head.camera
    if worst.gap < -ROUND_OFF:
        reason = f"{worst.state}: {worst.bodies} lack {-worst.gap:.2f} mm"
    elif camera.strain > camera.strain_limit:
        reason = (
            f"the arm strains by {100.0 * camera.strain:.3g} % when it lies straight, more than "
            f"{100.0 * camera.strain_limit:.3g} %"
        )
    return HeadCheck(
        rows=tuple(rows),
        least_gap=worst.gap,
        share_free=min(row.share_free for row in rows if row.state == "free, any pose"),
        reason=reason,
    )


def _check_stowed(head: Head) -> list[GapRow]:
    """Return the gaps under the cap, where all is straight, and of the cap that is pulled back."""
    arm, _ = head.lay_arm(free=False)
    discs = {"camera": (arm[0], 0.5 * head.camera.diameter, head.camera.straight_length)}
    for k, placed in enumerate(head.effectors):
        discs[name_effector(k)] = placed.place, placed.radius, placed.length
    gaps = {"cap and face, pulled back": head.cap.stroke - head.cap.length}
    for name, (place, radius, length) in discs.items():
        gaps[f"cap and {name}"] = head.inner_radius - radius - float(np.hypot(*place[:2]))
        gaps[f"cap's front and {name}"] = head.cap.find_front(free=False) - length
    for one, other in list_pairs(head):
        apart = float(np.linalg.norm(discs[one][0] - discs[other][0]))
        gaps[f"{one} and {other}"] = apart - discs[one][1] - discs[other][1]
    return [
        GapRow(state="under the cap", bodies=name, gap=gap, share_free=float(gap >= -ROUND_OFF))
        for name, gap in gaps.items()
    ]


@dataclass(frozen=True, kw_only=True)
class HeadChecking(Task):
    """Check what of a distal head collides: under the cap, at rest, and in all poses.

    Under the cap all is straight, the instruments are drawn in, and everything has to lie within
    the cap. Exit code 0: it fits, and nothing touches at rest; 1: not; 2: bad input. That some
    poses touch the camera or each other is no failure: the share that does not is stated.
    """

    name = "check"
    group = "head"
    result = HeadCheck

    head: str | None = head_field()
    samples: int = quantity(
        help="Poses of each end-effector.", default=400, low=10, high=100_000, whole=True
    )

    def run(self, progress: Progress = no_progress) -> HeadCheck:
        """Return what collides."""
        return check_head(read_head(self.head), samples=self.samples)

    def describe(self, found: HeadCheck) -> str:
        """Return the gaps as a table."""
        rows = [
            [row.state, row.bodies, f"{row.gap:z.2f}", f"{100.0 * row.share_free:.0f} %"]
            for row in found.rows
        ]
        table = format_rows(["state", "bodies", "least gap [mm]", "free"], rows)
        return "\n".join([table, found.reason or "It fits, and nothing touches at rest"])


@dataclass(frozen=True, kw_only=True, eq=False)
class HeadView(ClosedForm):
    """What a head's camera sees of where an instrument's tip can be.

    Shares are of places of the tip that are even in the backbone's lateral place; the camera does
    not move with it.

    Attributes
    ----------
    head : Head
    tip : (n, 3) float
        In the head's frame [mm].
    in_cone, in_focus, hidden, free : (n,) bool
        Whether the tip is in the cone of view, in the depth of view, behind something; whether
        nothing touches in that pose.
    share_in_cone, share_in_focus, share_hidden : float
    share_seen : float
        In cone and focus, and not hidden.
    share_used : float
        Seen, in a pose in which nothing touches.
    farthest : float
        Distance of the farthest place from the lens, along the camera's axis [mm].
    """

    head: Head
    tip: Floats = tabulated("mm", "tip_{}")
    in_cone: NDArray[np.bool_] = tabulated()
    in_focus: NDArray[np.bool_] = tabulated()
    hidden: NDArray[np.bool_] = tabulated()
    free: NDArray[np.bool_] = tabulated()
    share_in_cone: float = measured("")
    share_in_focus: float = measured("")
    share_hidden: float = measured("")
    share_seen: float = measured("")
    share_used: float = measured("")
    farthest: float = measured("mm")

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the places as the camera's picture shows them, and return the axes."""
        axes = take_axes(ax, x="picture, to the right [px]", y="picture, down [px]", equal=True)
        camera = self.head.look()
        pixels = camera.project(self.tip)
        seen = self.in_cone & self.in_focus & ~self.hidden
        for chosen, color, label in (
            (seen & self.free, "C2", "seen"),
            (seen & ~self.free, "C1", "seen, but something touches"),
            (~seen, "C3", "not seen"),
        ):
            axes.plot(*pixels[chosen].T, ".", color=color, label=label)
        middle, turn = 0.5 * camera.size[0], np.linspace(0.0, 2.0 * math.pi, 181)
        axes.plot(middle + middle * np.cos(turn), middle + middle * np.sin(turn), color="0.5")
        if axes.get_ylim()[0] < axes.get_ylim()[1]:
            axes.invert_yaxis()
        axes.legend(fontsize="x-small")
        return axes


def view_head(head: Head, *, number: int = 1, samples: int = 1000) -> HeadView:
    """Return what a head's camera sees of the places of an instrument's tip, the others at rest.

    Parameters
    ----------
    head : Head
    number : int
        Of the end-effector, from 1.
    samples : int
        About how many places.

    Raises
    ------
    InputError
        If there is no such end-effector, or `samples` is outside [10, 100000].
    """
    moved = head.get_effector(number)
    samples = check_integer("samples", samples, low=10, high=100_000)
    poses = moved.shape(moved.list_bends(samples))
    every = [placed.shape(np.zeros((1, 2))) for placed in head.effectors]
    every[number - 1] = poses
    in_cone, in_focus, hidden = see_tips(head, number - 1, every)
    named = list_bodies(head, every)
    own = named.pop(name_effector(number - 1))
    gaps = np.min([measure_gaps(own, other)[:, 0] for other in named.values()], axis=0)
    seen, free = in_cone & in_focus & ~hidden, gaps >= -ROUND_OFF
    _, (back, lens) = head.lay_arm()
    return HeadView(
        head=head,
        tip=poses.tip,
        in_cone=in_cone,
        in_focus=in_focus,
        hidden=hidden,
        free=free,
        share_in_cone=float(in_cone.mean()),
        share_in_focus=float(in_focus.mean()),
        share_hidden=float(hidden.mean()),
        share_seen=float(seen.mean()),
        share_used=float((seen & free).mean()),
        farthest=float(((poses.tip - lens) @ (lens - back)).max() / head.camera.length),
    )


@dataclass(frozen=True, kw_only=True)
class HeadViewing(Task):
    """Tell what a distal head's camera sees of where an instrument's tip can be.

    Shares of the places of the tip: in the cone of view, in the depth of view, not behind its own
    end-effector, its instrument, others at rest or the arm; and of those the poses in which nothing
    touches. The angles of the arm can be given, to compare poses of the camera.

    Exit code 0: done; 2: bad input.
    """

    name = "view"
    group = "head"
    result = HeadView

    head: str | None = head_field()
    effector: int = quantity(help="Which, from 1.", default=1, low=1, high=3, whole=True)
    rise_angle: float | None = quantity(
        "angle",
        "Bend of the arm outwards, in place of the head's.",
        default=None,
        low=0.0,
        high=3.0,
    )
    fall_angle: float | None = quantity(
        "angle", "Bend of the arm back, in place of the head's.", default=None, low=0.0, high=4.0
    )
    samples: int = quantity(
        help="Places of the tip.", default=1000, low=10, high=100_000, whole=True
    )

    def run(self, progress: Progress = no_progress) -> HeadView:
        """Return the shares."""
        head = read_head(self.head)
        given = {"rise_angle": self.rise_angle, "fall_angle": self.fall_angle}
        changes = {name: value for name, value in given.items() if value is not None}
        head = replace(head, camera=replace(head.camera, **changes))
        return view_head(head, number=self.effector, samples=self.samples)

    def describe(self, found: HeadView) -> str:
        """Return the shares in percent."""
        shares = {
            "in the cone of view": found.share_in_cone,
            "in the depth of view": found.share_in_focus,
            "hidden": found.share_hidden,
            "seen: in both, not hidden": found.share_seen,
            "seen, and nothing touches": found.share_used,
        }
        lines = [f"{100.0 * share:5.1f} %  {name}" for name, share in shares.items()]
        return "\n".join(
            [*lines, f"The farthest place is {found.farthest:.1f} mm ahead of the lens"]
        )
