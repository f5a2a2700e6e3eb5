"""Figures 5.1 to 5.12: segments of a tendon robot, and the tractrix."""

from __future__ import annotations

import math

import numpy as np

from bozzini.continuum import ArcModel, ContinuumRobot, LinkageModel, Section, Tendon
from bozzini.motion import move_free_chain
from bozzini.plot.style import AMBER, BLUE, COLORS, INK, RED, make_figure, make_panels

LENGTH, SPACING = 100.0, 5.0  # of our robot [mm]
QUARTER = 0.5 * math.pi * SPACING  # pulled for a bend of a right angle [mm]


def _make_robot(*angles):
    tendons = tuple(
        Tendon(name=f"t{k}", offset=SPACING, angle=angle) for k, angle in enumerate(angles)
    )
    return ContinuumRobot([Section(length=LENGTH, radius=6.0, tendons=tendons)])


def _place_tendons(robot, segments, pulled):
    """Return backbone joints (n + 1, 3) and the tendons' ends of each link (t, n + 1, 3)."""
    frames = LinkageModel(robot, segments=segments).shape(pulled).require().frames
    joints = frames[:, :3, 3]
    ends = [
        joints
        + SPACING * (frames[:, :3, 0] * math.cos(t.angle) + frames[:, :3, 1] * math.sin(t.angle))
        for t in robot.sections[0].tendons
    ]
    return joints, np.array(ends)


def fig_5_01():
    """Figures 5.1, 5.2, 5.4: a planar robot as 4-bar linkages, and one of them.

    Printed: the construction and the names of the links.

    Ours: 100 mm, 5 mm from backbone to cable, 10 segments, cable shortened by 7.85 mm.

    Beside the print: each segment's second crank has the length of its share of the cable.
    """
    joints, (ends,) = _place_tendons(_make_robot(0.0), 10, [QUARTER])
    straight, (cable,) = _place_tendons(_make_robot(0.0), 10, [0.0])
    figure, (left, right) = make_panels(1, 2, size=(7.4, 4.2))
    for inner, outer, color in ((straight, cable, "#a9b4bf"), (joints, ends, BLUE)):
        for pair in zip(inner, outer, strict=True):
            left.plot(*np.stack(pair)[:, [0, 2]].T, color=color, linewidth=1.0)
        left.plot(*inner[:, [0, 2]].T, "o-", color=color, markersize=2.5)
        left.plot(*outer[:, [0, 2]].T, "o-", color=color, markersize=2.5)
    left.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]")
    ring = np.stack([joints[0], joints[1], ends[1], ends[0]])[:, [0, 2]]
    names = ("first crank l0", "coupler a", "second crank l", "fixed link a")
    for k, name in enumerate(names):
        side = ring[[k, (k + 1) % 4]]
        right.plot(*side.T, "o-", color=COLORS[k], label=name)
    right.set(aspect="equal", xlabel="x [mm]")
    right.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.12))
    sizes = np.linalg.norm(np.diff(ends, axis=0), axis=1)
    off = np.abs(sizes - (LENGTH - QUARTER) / 10.0).max()
    return figure, f"second cranks {sizes[0]:.4f} mm, as (L0 − ΔL)/n within {max(off, 1e-9):.0e} mm"


def fig_5_03():
    """Figure 5.3: coupler angle over crank angle of one linkage.

    Printed: equation (5.1); no lengths.

    Ours: l0 = 10, l = 8, a = 5 mm.

    Beside the print: the smallest coupler angle is where (5.2) and (5.4) have it. (5.5) is that for
    small angles only.
    """
    crank, short, a = 10.0, 8.0, 5.0
    theta = np.linspace(math.radians(-40.0), math.radians(70.0), 2201)
    p, q = 2.0 * a * (crank * np.sin(theta) - a), -2.0 * a * crank * np.cos(theta)
    rest = short**2 - crank**2 - 2.0 * a**2 + 2.0 * a * crank * np.sin(theta)
    size = np.hypot(p, q)
    real = np.abs(rest) <= size
    open_by = np.arccos(np.where(real, rest / size, 0.0))
    figure, (axes,) = make_panels(size=(7.0, 3.8))
    branches = []
    for sign in (-1.0, 1.0):
        beta = np.mod(np.arctan2(q, p) + sign * open_by + math.pi, 2.0 * math.pi) - math.pi
        branches.append(np.where(real, beta, np.nan))
        line = np.where(np.abs(np.diff(branches[-1], prepend=np.nan)) < 0.3, branches[-1], np.nan)
        axes.plot(np.degrees(theta), np.degrees(line), color=BLUE)
    least = np.nanargmin(np.abs(np.array(branches)))
    branch, k = np.unravel_index(least, (2, len(theta)))
    beta, at = branches[branch][k], theta[k]
    axes.plot(np.degrees(theta), 2.0 * np.degrees(theta), ":", color=INK, label="β = 2θ, (5.2)")
    axes.plot(math.degrees(at), math.degrees(beta), "o", color=RED, label="smallest coupler angle")
    axes.set(xlabel="crank angle θ [°]", ylabel="coupler angle β [°]", ylim=(-20.0, 180.0))
    axes.legend(frameon=False)
    exact = 2.0 * math.asin((crank - short) / (2.0 * a))
    return figure, (
        f"least β {math.degrees(beta):.2f}° at θ {math.degrees(at):.2f}°; (5.4) "
        f"{math.degrees(exact):.2f}°, (5.5) {math.degrees((crank - short) / a):.2f}°"
    )


def fig_5_05_06():
    """Figures 5.5, 5.6: the linkages beside the arc, for several numbers of segments.

    Printed: no dimensions; that both are one but for the solver, and that the number of segments
    hardly matters.

    Ours: 100 mm, 5 mm spacing, a right angle; 5, 10, 20 and 50 segments.

    Beside the print: the chain lies close to the arc, but is off it by a term that falls with the
    square of the number of segments, whatever the solver: see the errata.
    """
    robot = _make_robot(0.0)
    turn = np.linspace(1e-9, 0.5 * math.pi, 100)
    radius = LENGTH / (0.5 * math.pi)
    arc = radius * np.stack([1.0 - np.cos(turn), np.sin(turn)], axis=1)
    figure, panels = make_panels(1, 2, size=(7.4, 4.0), sharey=True)
    value = []
    for axes, counts in zip(panels, ((20,), (5, 10, 50)), strict=True):
        axes.plot(*arc.T, color=INK, linewidth=3.0, alpha=0.35, label="arc, (5.6)")
        for count, color in zip(counts, COLORS, strict=False):
            points = LinkageModel(robot, segments=count).points([QUARTER])[:, [0, 2]]
            axes.plot(
                *points.T, "o-", color=color, markersize=3.0, linewidth=1.0, label=f"n = {count}"
            )
            value.append((count, np.linalg.norm(points[-1] - arc[-1])))
        axes.set(aspect="equal", xlabel="x [mm]")
        axes.legend(frameon=False, fontsize=9)
    panels[0].set_ylabel("z [mm]")
    rows = ", ".join(f"{gap:.3f} (n = {n})" for n, gap in sorted(value))
    return figure, f"tip off the arc by {rows} mm"


def fig_5_07():
    """Figures 5.7 to 5.10: a robot in space as adjoined linkages, cables pulled alike or not.

    Printed: cables a right angle apart; no dimensions.

    Ours: 100 mm, 5 mm spacing, 10 segments; 4 and 4 mm (5.9), 6 and 2 mm (5.10).

    Beside the print: linkages and arc lie on each other but for the term in the number of segments;
    the last constraint of (5.10) holds by itself.
    """
    robot = _make_robot(0.0, 0.5 * math.pi)
    figure = make_figure((8.0, 4.2))
    value = []
    for k, (name, pulled) in enumerate((("5.9", (4.0, 4.0)), ("5.10", (6.0, 2.0)))):
        joints, cables = _place_tendons(robot, 10, pulled)
        arc = ArcModel(robot).shape(pulled).require().frames[:, :3, 3]
        space = figure.add_subplot(1, 2, k + 1, projection="3d")
        for index in range(len(joints)):
            ring = np.stack([cables[0][index], joints[index], cables[1][index]])
            space.plot(*ring.T, color="#a9b4bf", linewidth=0.9)
        for line in cables:
            space.plot(*line.T, color=AMBER, linewidth=0.9)
        space.plot(*arc.T, color=INK, linewidth=3.0, alpha=0.35, label="arc")
        space.plot(*joints.T, "o-", color=BLUE, markersize=2.5, label="linkages")
        space.set_title(f"{name}: {pulled[0]:g} and {pulled[1]:g} mm", fontsize=10, loc="left")
        space.set_box_aspect(np.maximum(np.ptp(joints, axis=0), 40.0))
        space.set(xlim=(0, max(40.0, joints[-1, 0])), ylim=(-5, 40), zlim=(0, 100))
        space.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        space.legend(frameon=False, fontsize=9, loc="upper left")
        spokes = (cables - joints) / SPACING
        square = np.abs(np.sum(spokes[0] * spokes[1], axis=1)).max()
        value.append(
            f"{name}: tip off the arc by {np.linalg.norm(joints[-1] - arc[-1]):.3f} mm, "
            f"cables a right angle apart within {max(square, 1e-9):.0e}"
        )
    return figure, "; ".join(value)


def fig_5_11():
    """Figure 5.11: the tractrix of one link.

    Printed: equation (5.12); a link along y whose head moves along x.

    Ours: a link of 10 mm, moved by 30 mm.

    Beside the print: the closed form is met. It is not the least move of the tail over a finite
    step, as the text beside (5.12) and (5.13) has it, but the limit of ever smaller ones: see the
    errata.
    """
    link = 10.0
    along = np.linspace(0.0, 30.0, 61)
    heads = np.stack([along, 0.0 * along], axis=1)
    start = np.array([[0.0, 0.0], [0.0, link]])
    tails = move_free_chain(start, heads)[:, 1]
    printed = np.stack([along - link * np.tanh(along / link), link / np.cosh(along / link)], axis=1)
    once = move_free_chain(start, [[0.0, 0.0], [link, 0.0]], scheme="least")[-1, 1]
    figure, (axes,) = make_panels(size=(7.0, 3.0))
    for k in range(0, 61, 6):
        axes.plot(*np.stack([heads[k], tails[k]]).T, "o-", color="#a9b4bf", markersize=3.0)
    axes.plot(*tails.T, color=BLUE, linewidth=2.0, label="move_free_chain")
    axes.plot(*printed.T, ":", color=INK, linewidth=2.0, label="(5.12)")
    axes.plot(*once, "s", color=RED, label="(5.13) in one step of 10 mm")
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    off = np.linalg.norm(tails - printed, axis=1).max()
    moved = [np.linalg.norm(tail - start[1]) for tail in (tails[20], once)]
    return figure, (
        f"(5.12) met within {max(off, 1e-9):.0e} mm; for a head step of one link the tail on "
        f"the tractrix is {moved[0]:.2f} mm from its old place, that of (5.13) {moved[1]:.2f} mm"
    )


def fig_5_12():
    """Figure 5.12: a chain pulled by its head.

    Printed: that each joint's displacement is at most that of the one before; no numbers.

    Ours: 8 links of 10 mm, the head moved by 60 mm.

    Beside the print: the way that a joint goes falls from joint to joint. Its displacement, of
    which the thesis states it, need not: see the errata.
    """
    chain = np.stack([np.zeros(9), 10.0 * np.arange(9)], axis=1)
    along = np.linspace(0.0, 60.0, 121)
    poses = move_free_chain(chain, np.stack([along, 0.0 * along], axis=1))
    figure, (axes,) = make_panels(size=(7.0, 4.4))
    for k in range(0, 121, 20):
        label = "chain" if k == 120 else None
        shade = 0.25 + 0.75 * k / 120
        axes.plot(*poses[k].T, "o-", color=BLUE, markersize=3.0, alpha=shade, label=label)
    for joint in range(9):
        label = "ways of joints" if joint == 8 else None
        axes.plot(*poses[:, joint].T, ":", color=AMBER, linewidth=1.0, label=label)
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]")
    axes.legend(frameon=False, fontsize=9)
    ways = np.linalg.norm(np.diff(poses, axis=0), axis=2).sum(axis=0)
    moved = np.linalg.norm(poses[-1] - poses[0], axis=1)
    rows = (", ".join(f"{m:.1f}" for m in row) for row in (ways, moved))
    return figure, "from head to end ways of {} mm, displacements of {} mm".format(*rows)
