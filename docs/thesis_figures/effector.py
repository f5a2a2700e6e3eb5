"""Figures of chapter 4: the end-effector."""

from __future__ import annotations

import math

import numpy as np

from bozzini.continuum import ContinuumRobot, LinkageModel, Section, Tendon
from bozzini.effector import (
    Effector,
    bend,
    effector_preset,
    find_reach,
    fit_cubic,
    project_inverse,
    solve_inverse,
    trace_circle,
    workspace,
)
from bozzini.plot.effector import draw_deflection, draw_trace, pick_colors
from bozzini.plot.style import AMBER, BLUE, GREEN, INK, LUMEN, RED, make_figure, make_panels

FULL, LOWER, LEAST = 0.6894, 0.5516, 0.4136  # the thesis's pressures [MPa]
THESIS = Effector.from_preset("thesis")
PROTOTYPE = Effector(effector_preset("prototype"))


def _draw_front(axes, effector=PROTOTYPE):
    """Draw the projected workspace and the way of each muscle alone."""
    space = workspace(effector)
    axes.fill(*space.boundary.T, facecolor=LUMEN, edgecolor=BLUE)
    units = np.stack([np.cos(effector.design.angles), np.sin(effector.design.angles)], axis=1)
    for unit, far, (name, color) in zip(
        units, space.reach.amplitudes, pick_colors(effector.design.names).items(), strict=True
    ):
        axes.plot(*np.stack([0.0 * unit, far * unit]).T, color=color, linewidth=2.0)
        axes.text(*(1.12 * far * unit), name, color=color, ha="center", va="center")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    return space, units


def fig_4_05_06():
    """Figures 4.5, 4.6: backbone and muscle without guiding discs, and with them.

    Printed: 45 mm, 15 segments, 6.9 mm of contraction (Table 4.1).

    Ours: an offset of 4 mm, which the tables imply.

    Beside the print: without discs the muscle comes nearer to the backbone, and the section
    deflects less than an arc, which is why the thesis has a model of its own for it.
    """
    design = THESIS.design
    free = bend(design, 6.9)
    tendon = Tendon(name="t", offset=design.offset, angle=0.0)
    guided = ContinuumRobot([Section(length=45.0, radius=5.0, tendons=(tendon,))])
    arc = LinkageModel(guided, segments=15).points([6.9])[:, [0, 2]]
    turn = 2.0 * math.asin(6.9 / (2.0 * 15.0 * design.offset)) * np.arange(16)
    outer = arc + design.offset * np.stack([np.cos(turn), -np.sin(turn)], axis=1)
    figure, panels = make_panels(1, 2, size=(7.4, 4.4), sharex=True, sharey=True)
    for axes, inner, cable, name in (
        (panels[0], np.asarray(free.backbone), np.asarray(free.muscle), "no discs, (4.4)"),
        (panels[1], arc, outer, "guiding discs"),
    ):
        for pair in zip(inner, cable, strict=True):
            axes.plot(*np.stack(pair).T, color="#a9b4bf", linewidth=0.9)
        axes.plot(*inner.T, "o-", color=INK, markersize=2.5, label="backbone")
        axes.plot(*cable.T, "o-", color=RED, markersize=2.5, label="muscle")
        axes.set(aspect="equal", xlabel="lateral [mm]")
        axes.set_title(f"{name}: {inner[-1, 0]:.1f} mm", fontsize=10, loc="left")
    panels[0].set_ylabel("along the axis [mm]")
    panels[0].legend(frameon=False, fontsize=9)
    least = float(np.asarray(free.spacing)[1:].min())
    return figure, (
        f"δe {float(free.lateral):.2f} mm without discs, {arc[-1, 0]:.2f} mm with them; the muscle "
        f"comes to {least:.2f} mm from the backbone"
    )


def fig_4_07():
    """Figure 4.7: the tip displacements of two muscles, added by the thesis's steps.

    Printed: the construction; R and G at 689.4 and 413.6 kPa in the text beside it.

    Ours: an offset of 4 mm, the muscles of Tables 4.1 to 4.4.

    Beside the print: the second displacement is turned with the end of the first pose. The sum
    leaves the length that the backbone has: see the errata.
    """
    pressures = [{"R": FULL}, {"G": LEAST}, {"R": FULL, "G": LEAST}]
    one, two = (THESIS.forward(p) for p in pressures[:2])
    both = THESIS.forward(pressures[2], method="thesis", order=["R", "G"])
    last = np.diff(np.asarray(one.backbone), axis=0)[-2:]
    last /= np.linalg.norm(last, axis=1, keepdims=True)
    axis = np.cross(last[0], last[1])
    axis /= np.linalg.norm(axis)
    beta = math.acos(last[1, 2])
    start = np.array([0.0, 0.0, 45.0])
    first, second = np.asarray(one.tip) - start, np.asarray(two.tip) - start
    cross = np.cross(np.eye(3), axis)
    turned = (
        second + math.sin(beta) * cross @ second + (1.0 - math.cos(beta)) * cross @ cross @ second
    )
    figure = make_figure((7.0, 4.6))
    space = figure.add_subplot(projection="3d")
    space.plot(*np.stack([0.0 * start, start]).T, color="#8a97a5", label="ξ0")
    for pose, color, name in ((one, RED, "ξ1, R"), (two, GREEN, "ξ2, G"), (both, INK, "both")):
        space.plot(*np.asarray(pose.backbone).T, color=color, linewidth=2.0, label=name)
    for origin, arrow, color, name in (
        (start, first, RED, "d1"),
        (start, second, GREEN, "d2"),
        (start + first, turned, AMBER, "d2'"),
    ):
        space.quiver(*origin, *arrow, color=color, linewidth=1.2, arrow_length_ratio=0.12)
        space.text(*(origin + 0.6 * arrow), name, color=color)
    space.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    space.set_box_aspect((1, 1, 1.4))
    space.view_init(elev=18.0, azim=-60.0)
    space.legend(frameon=False, fontsize=9, loc="upper left")
    met = np.asarray(both.tip) - start - first
    off = math.degrees(math.acos(met @ turned / np.linalg.norm(met) / np.linalg.norm(turned)))
    return figure, (
        f"β1 {math.degrees(beta):.1f}°; the tip lies along d2' to {max(off, 1e-5):.0e}°; "
        f"backbone {45.0 + float(both.length_error):.1f} mm long in place of 45"
    )


def fig_4_09():
    """Figures 4.9, 4.17 to 4.19: directions of the muscles, workspace, and a place in it.

    Printed: angles of 307.5°, 219° and 75°, 827 kPa; amplitudes and the place only as drawings.

    Ours: amplitudes by the energy model of the prototype, the place (8, -6) mm.

    Beside the print: three parallelograms on the muscles' directions make the workspace. The
    split is (4.13), and adds up.
    """
    figure, (left, right) = make_panels(1, 2, size=(9.0, 4.4))
    design = PROTOTYPE.design
    space, units = _draw_front(left)
    for unit, angle in zip(units, np.degrees(design.angles), strict=True):
        left.text(*(5.0 * unit + [0.4, 0.4]), f"{angle % 360.0:g}°", fontsize=9)
    left.set_title("4.9, 4.17, 4.18: three muscles at 827 kPa", fontsize=10, loc="left")
    _draw_front(right)
    target = np.array([8.0, -6.0])
    split = project_inverse(design, target, amplitudes=space.reach.amplitudes)
    i, j = split.pair
    parts = split.displacements[:, None] * units
    right.plot(*np.stack([parts[i], target, parts[j]]).T, "--", color=INK)
    right.plot(*target, "o", color=INK)
    right.set_title("4.19: (8, −6) mm from two muscles", fontsize=10, loc="left")
    error = float(np.linalg.norm(parts.sum(axis=0) - target))
    names = ", ".join(f"{design.names[k]} {split.displacements[k]:.2f} mm" for k in (i, j))
    far = ", ".join(f"{a:.2f}" for a in space.reach.amplitudes)
    return (
        figure,
        f"amplitudes {far} mm; {names}, which add up to the place within {max(error, 1e-9):.0e} mm",
    )


def fig_4_10_12():
    """Figures 4.10 to 4.12: poses under one muscle.

    Printed: R and G at 689.4 kPa, G at 551.6 kPa; deflections of 20.4 and 18.5 mm (Tables 4.1,
    4.3); the points of the reconstruction are in the pictures only.

    Ours: an offset of 4 mm, EI of 200 N mm² and the load path, which the tables imply.

    Beside the print: within 0.1 mm of the tables.
    """
    figure, panels = make_panels(1, 3, size=(8.0, 4.0), sharex=True, sharey=True)
    value = []
    for axes, (name, pressure) in zip(
        panels, (("R", FULL), ("G", FULL), ("G", LOWER)), strict=True
    ):
        pose = THESIS.forward({name: pressure})
        place = THESIS.design.index(name)
        drawn = bend(THESIS.design, float(pose.contraction[place]))
        axes.plot(*np.asarray(drawn.backbone).T, "o-", color=INK, markersize=2.5, label="backbone")
        axes.plot(*np.asarray(drawn.muscle).T, "-", color=pick_colors("RGB")[name], label=name)
        axes.plot(*np.stack([drawn.tip, drawn.holder_tip]).T, color="#8a97a5", linewidth=5.0)
        axes.set(aspect="equal", xlabel="lateral [mm]")
        axes.set_title(f"{name}, {1e3 * pressure:.1f} kPa", fontsize=10, loc="left")
        axes.legend(frameon=False, fontsize=9)
        value.append(f"{float(pose.lateral):.2f}")
    panels[0].set_ylabel("along the axis [mm]")
    return figure, f"deflections {', '.join(value)} mm"


def fig_4_13_14():
    """Figures 4.13, 4.14: poses under two muscles, by the thesis's steps and by superposition.

    Printed: R and G at 689.4 kPa; G at 689.4 and R at 413 kPa; no deflection.

    Ours: as for Fig. 4.10.

    Beside the print: no number to compare. Both ways have one direction; by the steps the
    deflection depends on the order, and the backbone changes its length.
    """
    figure = make_figure((8.0, 4.2))
    value = []
    for k, (given, name) in enumerate(
        (
            ({"R": FULL, "G": FULL}, "4.13: R, G 689.4 kPa"),
            ({"R": LEAST, "G": FULL}, "4.14: G 689.4, R 413.6 kPa"),
        )
    ):
        space = figure.add_subplot(1, 2, k + 1, projection="3d")
        found = []
        for method, color in (("thesis", RED), ("superposition", BLUE)):
            pose = THESIS.forward(given, method=method)
            space.plot(*np.asarray(pose.backbone).T, color=color, linewidth=2.0, label=method)
            found.append(f"{float(pose.lateral):.1f} mm to {math.degrees(pose.azimuth) % 360:.1f}°")
        space.set(xlim=(-25, 25), ylim=(-25, 25), zlim=(0, 50))
        space.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
        space.set_title(name, fontsize=10, loc="left")
        space.legend(frameon=False, fontsize=9)
        other = THESIS.forward(given, method="thesis", order=["G", "R"])
        value.append(
            f"{name.split(':')[0]}: steps {found[0]}, with G first {float(other.lateral):.1f} mm, "
            f"superposition {found[1]}"
        )
    return figure, "; ".join(value)


def fig_4_16():
    """Figure 4.16: deflection by one muscle over its pressure, and a cubic.

    Printed: a forceps of 2.5 mm inside; neither its rigidity nor the four coefficients.

    Ours: the prototype without a catheter, the cubic from 100 kPa on.

    Beside the print: no number to compare. Below the pressure from which it is fitted no cubic
    follows the dead band.
    """
    cubic = fit_cubic(PROTOTYPE, "R", start=0.1)
    figure = draw_deflection(PROTOTYPE, cubics={"R": cubic}, points=81)
    figure.set_size_inches(8.0, 3.6)
    return figure, f"cubic off by {cubic.rms_error:.2f} mm rms from 100 kPa on"


def fig_4_20_21():
    """Figures 4.20, 4.21: the predicted direction of two muscles.

    Printed: G at 689 kPa, R at the largest pressure; the measured direction is off by about 9°,
    without numbers.

    Ours: as for Fig. 4.10, 827 kPa as the largest.

    Beside the print: the measurement cannot be had. Both ways of adding up agree on the direction,
    so neither explains 9°.
    """
    figure, (axes,) = make_panels(size=(6.0, 4.4))
    _draw_front(axes, THESIS)
    value = []
    for method, color in (("superposition", INK), ("thesis", AMBER)):
        pose = THESIS.forward({"G": FULL, "R": 0.827}, method=method)
        axes.annotate(
            "",
            np.asarray(pose.lateral_vector),
            (0.0, 0.0),
            arrowprops={"color": color, "width": 1.0},
        )
        axes.plot([], [], color=color, label=method)
        value.append(f"{math.degrees(pose.azimuth) % 360:.1f}° ({method})")
    axes.legend(frameon=False, fontsize=9)
    return figure, f"direction {', '.join(value)}"


def fig_4_22():
    """Figure 4.22: targets outside the workspace.

    Printed: the rule, (4.15) and (4.16); no numbers.

    Ours: targets 30 mm away in eight directions, the prototype's amplitudes.

    Beside the print: the direction is kept and one muscle is at its largest, as both equations
    have it.
    """
    figure, (axes,) = make_panels(size=(6.0, 4.6))
    space, units = _draw_front(axes)
    turn = np.arange(8) * math.pi / 4.0 + 0.2
    targets = 30.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    found = project_inverse(PROTOTYPE.design, targets, amplitudes=space.reach.amplitudes)
    for one, end in zip(targets, found.delivered, strict=True):
        axes.plot(*np.stack([0.0 * one, one]).T, ":", color="#8a97a5", linewidth=1.0)
        axes.plot(*end, "o", color=INK)
    full = (found.displacements >= space.reach.amplitudes * (1.0 - 1e-12)).any(axis=1)
    off = np.linalg.norm(found.displacements @ units - found.delivered, axis=1).max()
    return figure, (
        f"a muscle at its amplitude in {full.sum()} of {len(full)}; "
        f"displacements add up to the place within {max(off, 1e-9):.0e} mm"
    )


def fig_4_23():
    """Figure 4.23: places along one muscle's line, and three that take two muscles.

    Printed: six places with their pressures, as marks and numbers inside the picture, which our
    text of the thesis does not have.

    Ours: thirds of G's amplitude; (8, -6), (-5, 5) and (0, -9) mm; the prototype.

    Beside the print: a single muscle gives a line and two give the rest, as there.
    """
    figure, (axes, bars) = make_panels(1, 2, size=(8.4, 4.0))
    _draw_front(axes)
    design = PROTOTYPE.design
    far = find_reach(PROTOTYPE).amplitudes[design.index("G")]
    unit = np.array([math.cos(design.angles[1]), math.sin(design.angles[1])])
    places = np.concatenate(
        [np.arange(1, 4)[:, None] / 3.0 * 0.999 * far * unit, [[8, -6], [-5, 5], [0, -9]]]
    )
    found = solve_inverse(PROTOTYPE, places)
    back = PROTOTYPE.forward(found.pressures)
    axes.plot(*places[:3].T, "o", color=RED)
    axes.plot(*places[3:].T, "o", color=BLUE)
    for k, place in enumerate(places):
        axes.annotate(f"P{k + 1}", place, (4, 4), textcoords="offset points", fontsize=9)
    for k, (name, color) in enumerate(pick_colors(design.names).items()):
        bars.bar(
            np.arange(6) + 0.25 * (k - 1),
            1e3 * found.pressures[:, k],
            0.25,
            color=color,
            label=name,
        )
    bars.set(xticks=range(6), xticklabels=[f"P{k}" for k in range(1, 7)], ylabel="pressure [kPa]")
    bars.legend(frameon=False, fontsize=9)
    off = np.linalg.norm(back.lateral_vector - places, axis=1).max()
    used = (found.pressures > 1e-6).sum(axis=1)
    return (
        figure,
        f"muscles used {', '.join(map(str, used))}; places met within {max(off, 1e-9):.0e} mm",
    )


def fig_4_24():
    """Figure 4.24: pressures that draw a circle with the tip.

    Printed: an approximate circle, its pressures inside the picture only.

    Ours: a radius of 8 mm about the axis, the prototype without a catheter.

    Beside the print: it closes without a return to the middle, as there.
    """
    trace = trace_circle(PROTOTYPE, 8.0)
    figure = draw_trace(trace, PROTOTYPE.design.names)
    figure.set_size_inches(8.0, 3.6)
    return figure, (
        f"met within {max(float(trace.error.max()), 1e-9):.0e} mm; "
        f"largest pressure {1e3 * float(trace.pressures.max()):.0f} kPa"
    )
