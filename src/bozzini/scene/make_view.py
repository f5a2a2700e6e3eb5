"""From what has a shape to a `View`: plans, tracts, ducts, robots, poses, workspaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..anatomy.tract import LabelTract, SurfaceTract
from ..continuum.dynamics import ShapeHistory
from ..continuum.kinematics import ContinuumRobot
from ..continuum.shape import Shape
from ..continuum.workspace import ContinuumWorkspace, WorkspaceSample, sample_workspace
from ..duct.base import Duct, SampledField
from ..duct.field import RefinedField
from ..duct.tree import LumenTree
from ..effector.effector import Effector
from ..effector.pose import EffectorPose
from ..effector.workspace import Workspace
from ..errors import GeometryError, InputError
from ..head.anchor import BLOCKED, OUT_OF_REACH, REACHED, HeadReach, Stand
from ..head.design import Head, SectionPoses
from ..head.shape import HeadPose, list_bodies
from ..motion.actuate.actuation import Actuation
from ..motion.branches import TreeReach
from ..motion.plan import Plan
from ..motion.scope import Introducer
from ..numeric.arrays import Floats
from ..numeric.level_sets import find_level_set
from ..numeric.polylines import interpolate_polyline, measure_arc_length
from ..plot.plan_data import (
    PlanCentreline,
    find_link_length,
    find_radius,
    find_refusal,
    read_centreline,
)
from ..plot.scope import REST
from ..plot.style import choose_clearance_scale
from .scene import TractMesh, prepare_tract
from .view import Body, Chart, Cloud, Mark, Surface, View

Wall = LabelTract | SurfaceTract | Duct
Shown: TypeAlias = (
    Plan | Wall | ContinuumRobot | Shape | WorkspaceSample | ContinuumWorkspace | Effector
    | EffectorPose | Workspace | Cloud | Actuation | Head | HeadPose | HeadReach
    | LumenTree | TreeReach | ShapeHistory
)  # fmt: skip

MOST_FACES = 120_000
"""Faces of a wall that are shown; a finer one is simplified, and the view says so."""

MOST_JOINTS = 1_200_000
"""Joints of all steps that are kept; of more, steps are left out, and the view says so."""

_GRID_NODES = 96  # of a duct without a grid, along its longest side
_SIDES = 48
_INTRODUCER = 60.0  # mm of it that are drawn
_LINE = "#c99a1e"
_TIGHT = 3  # tight places that are marked
_TIPS = 2000


def make_view(thing: Shown, wall: Wall | None = None, *, title: str = "") -> View:
    """Return the view of anything that has a shape.

    Parameters
    ----------
    thing : Plan, tract, duct, robot, shape, end-effector, pose, workspace or points
    wall : tract or duct, optional
        What is round it.
    title : str

    Raises
    ------
    InputError
        If there is no view of it.
    GeometryError
        If a duct is planar, or has no inside.
    """
    first = view_plan(thing, wall) if isinstance(thing, Plan) else _view_thing(thing)
    around = [] if wall is None or isinstance(thing, Plan) else [_view_wall(wall)]
    return join_views([first, *around], title=title)


def join_views(views: Sequence[View], *, title: str = "") -> View:
    """Return one view of several; the first that has axes, a scale or charts gives them."""
    return View(
        title=title or views[0].title,
        surfaces=tuple(item for view in views for item in view.surfaces),
        bodies=tuple(item for view in views for item in view.bodies),
        points=tuple(item for view in views for item in view.points),
        marks=tuple(item for view in views for item in view.marks),
        charts=next((view.charts for view in views if view.charts), ()),
        axes=next((view.axes for view in views if view.axes), None),
        scale=next((view.scale for view in views if view.scale), None),
        notes=tuple(dict.fromkeys(note for view in views for note in view.notes)),
    )


def _view_thing(thing: Shown) -> View:
    if isinstance(thing, (LabelTract, SurfaceTract, Duct)):
        return _view_wall(thing)
    if isinstance(thing, Shape):
        return _view_shape(thing)
    if isinstance(thing, ShapeHistory):
        return _view_history(thing)
    if isinstance(thing, ContinuumRobot):
        straight = _view_shape(thing.forward(np.zeros(len(thing.tendons))))
        if not (thing.is_parallel and thing.is_straight):
            return straight
        tips = sample_workspace(thing, _TIPS).tips
        return join_views([straight, _view_tips(tips, f"{_TIPS} places of the tip")])
    if isinstance(thing, Actuation):
        return _view_actuation(thing)
    if isinstance(thing, (ContinuumWorkspace, WorkspaceSample)):
        sample = thing.sample if isinstance(thing, ContinuumWorkspace) else thing
        return _view_tips(sample.tips, "places of the tip")
    if isinstance(thing, Workspace):
        return _view_tips(np.concatenate([thing.tip, thing.boundary_tip]), "places of the tip")
    if isinstance(thing, Effector):
        pose = _view_pose(thing.forward(np.zeros(len(thing.models))), radius=thing.design.offset)
        return join_views([pose, _view_thing(thing.workspace())])
    if isinstance(thing, EffectorPose):
        return _view_pose(thing)
    if isinstance(thing, (Head, HeadPose)):
        return _view_head(thing)
    if isinstance(thing, HeadReach):
        return _view_reach(thing)
    if isinstance(thing, LumenTree):
        return _view_tree(thing)
    if isinstance(thing, TreeReach):
        return _view_branches(thing)
    if isinstance(thing, Cloud):
        return View(title=thing.name, points=(thing,))
    raise InputError(f"there is no view of a {type(thing).__name__}")


def view_plan(plan: Plan, wall: Wall | View | None = None, *, title: str = "") -> View:
    """Return the view of a plan: the scope at every step, the way, marks and charts.

    Parameters
    ----------
    plan : Plan
    wall : tract, duct or View, optional
        The wall, or how it is drawn as the plan is for it. Without it the widest tube round the
        centreline that stays inside is shown.
    title : str

    Raises
    ------
    InputError
        If the plan is planar.
    """
    if plan.joints.shape[2] != 3:
        raise InputError(f"joints has shape {plan.joints.shape}: a view needs (steps, joints, 3)")
    line = read_centreline(plan)
    known = plan.head_arc_length[:, None] - find_link_length(plan) * np.arange(plan.links) >= -1e-9
    clearance = np.where(known & np.isfinite(plan.clearance), plan.clearance, np.nan)
    least = np.where(np.isnan(clearance), np.inf, clearance).min(axis=1)
    radius = find_radius(plan) or 0.05 * find_link_length(plan)
    notes = []
    count = min(plan.steps, max(2, MOST_JOINTS // plan.joints.shape[1]))
    steps = np.unique(np.linspace(0, plan.steps - 1, count).astype(np.int64))
    steps = np.union1d(steps, [int(np.argmin(least))])
    if len(steps) < plan.steps:
        notes.append(f"{len(steps)} of {plan.steps} steps are shown, the tightest among them.")
    surfaces = [] if plan.introducer is None else [_draw_introducer(plan.introducer)]
    if wall is None:
        tube = draw_tube(line.points, line.radius)
        surfaces.insert(0, Surface(vertices=tube[0], faces=tube[1], name="inscribed tube"))
        notes.append(
            "The wall is not known here: shown is a tube round the centreline, as wide as the "
            "largest ball at each place."
        )
    scope = Body(
        joints=plan.joints[steps],
        radius=radius,
        clearance=clearance[steps],
        insertion=plan.head_arc_length[steps],
    )
    way = Body(
        joints=line.points[None],
        radius=0.08 * radius,
        name="centreline" if line.is_centreline else "path of the head",
        color=_LINE,
        role="line",
    )
    bodies = [scope, way]
    reached = max(0.0, float(line.to_centreline(plan.head_arc_length).max()))
    rest = line.points_beyond(reached)
    if plan.status == "stopped" and len(rest) > 1:
        bodies.append(
            Body(
                joints=rest[None], radius=0.2 * radius, name="not reached", color=REST, role="line"
            )
        )
    charts = (
        Chart(name="smallest clearance", unit="mm", values=least[steps]),
        Chart(
            name="largest joint angle",
            unit="\N{DEGREE SIGN}",
            values=np.degrees(measure_angles(plan.joints[steps]).max(axis=1, initial=0.0)),
            kind="angle",
        ),
    )
    around = [] if wall is None else [wall if isinstance(wall, View) else _view_wall(wall)]
    inflation = plan.inflation if isinstance(wall, View) else getattr(wall, "inflation", 0.0)
    if plan.inflation > 0.0 and inflation != plan.inflation:
        notes.append(
            f"The plan is for a wall moved outwards by {plan.inflation:g} mm; it is shown as given."
        )
    source = plan.input.source if plan.input is not None else None
    view = View(
        title=title or f"Insertion plan{f': {source}' if source else ''}",
        surfaces=tuple(surfaces),
        bodies=tuple(bodies),
        marks=_list_marks(plan, line, clearance, steps),
        charts=charts,
        axes=getattr(wall, "axes" if isinstance(wall, View) else "frame", None) or "RAS",
        scale=choose_clearance_scale(clearance),
        notes=tuple(notes),
    )
    return join_views([view, *around])


def measure_angles(joints: Floats) -> Floats:
    """Return the angle at each joint between two links [rad], (..., n, 3) to (..., n - 2)."""
    links = np.diff(joints, axis=-2)
    links /= np.maximum(np.linalg.norm(links, axis=-1, keepdims=True), 1e-12)
    sine = np.linalg.norm(np.cross(links[..., :-1, :], links[..., 1:, :]), axis=-1)
    cosine = (links[..., :-1, :] * links[..., 1:, :]).sum(axis=-1)
    return np.asarray(np.arctan2(sine, cosine))


def _list_marks(
    plan: Plan, line: PlanCentreline, clearance: Floats, steps: NDArray[np.int64]
) -> tuple[Mark, ...]:
    """Return the ends of the way, the tightest places at these steps, and the refusal."""
    marks = [
        Mark(place=line.points[0], text="entry", kind="start"),
        Mark(place=line.points[-1], text="goal", kind="goal"),
    ]
    refusal = find_refusal(plan)
    if refusal is not None:
        marks.append(Mark(place=line.point_at(refusal.at), text=refusal.text, kind="refused"))
    # The tightest moments, each a twentieth of the way or more from those before it.
    open_ = np.where(np.isnan(clearance), np.inf, clearance)[steps]
    places = 0.5 * (plan.joints[steps, 1:] + plan.joints[steps, :-1])
    for k in range(_TIGHT):
        step, link = np.unravel_index(int(np.argmin(open_)), open_.shape)
        value = float(open_[step, link])
        if not np.isfinite(value):
            break
        word = "tightest" if k == 0 else "tight"
        sign = "\N{MINUS SIGN}" if value < 0.0 else ""
        place = places[step, link]
        text = f"{word}: {sign}{abs(value):.2f} mm"
        marks.append(Mark(place=place, text=text, kind="tight", step=int(step)))
        near = np.linalg.norm(places - place, axis=-1) < 0.08 * line.length
        open_ = np.where(near, np.inf, open_)
    return tuple(marks)


def draw_wall(wall: Wall, *, most_faces: int = MOST_FACES) -> tuple[TractMesh, tuple[str, ...]]:
    """Return the wall as triangles that turn outwards, and in sentences what is not exact.

    Raises
    ------
    GeometryError
        If a duct is planar, or has no inside.
    """
    notes = []
    if isinstance(wall, RefinedField):
        wall = wall.coarse
    if isinstance(wall, SurfaceTract):
        vertices, faces = wall.vertices, wall.faces
    elif isinstance(wall, LabelTract):
        mask = wall.mask.astype(np.float32)
        vertices, faces = _find_level(-mask, -0.5)
        vertices = vertices @ wall.affine[:3, :3].T + wall.affine[:3, 3]
    elif isinstance(wall, SampledField):
        vertices, faces = _find_level(wall.values, wall.inflation)
        vertices = wall.to_world(vertices * wall.spacing)
        grid = " x ".join(f"{size:.3g}" for size in wall.spacing)
        notes.append(f"The wall is drawn from distances on a grid of {grid} mm.")
    else:
        vertices, faces, step = _sample_duct(wall)
        notes.append(f"The wall is drawn from distances on a grid of {step:.3g} mm.")
    mesh = prepare_tract((vertices, faces), max_faces=most_faces)
    if len(faces) > most_faces:
        notes.append(
            f"The wall is simplified from {len(faces)} to {len(mesh.faces)} triangles to look at; "
            "clearances are of the wall itself."
        )
    return mesh, tuple(notes)


def _view_wall(wall: Wall) -> View:
    mesh, notes = draw_wall(wall)
    return View(
        title=getattr(wall, "source", "") or getattr(wall, "wall", "") or "wall",
        surfaces=(Surface(vertices=mesh.vertices, faces=mesh.faces),),
        axes=getattr(wall, "frame", None),
        notes=notes,
    )


def _find_level(values: NDArray[np.float32], level: float) -> tuple[Floats, NDArray[np.int64]]:
    """Return the level set of values on a grid, in steps of the grid."""
    vertices, faces = find_level_set(values, level)
    if not len(faces):
        raise GeometryError("the duct has no inside: no node of its grid lies within")
    # In the order of the grid the triangles of one side would be merged before those of another.
    return vertices, np.random.default_rng(0).permutation(faces)


def _sample_duct(duct: Duct) -> tuple[Floats, NDArray[np.int64], float]:
    """Return the wall of a duct by distances on a grid of its own, and the step [mm]."""
    low, high = duct.bounds
    if len(low) != 3:
        raise GeometryError("the duct is planar: a view needs one in space")
    step = float((high - low).max()) / _GRID_NODES
    sides = [
        np.arange(a - 2.0 * step, b + 2.0 * step, step) for a, b in zip(low, high, strict=True)
    ]
    nodes = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    values = duct.signed_distance(nodes.reshape(-1, 3)).reshape(nodes.shape[:3])
    vertices, faces = _find_level(values.astype(np.float32), 0.0)
    return vertices * step + nodes[0, 0, 0], faces, step


def _draw_introducer(tube: Introducer) -> Surface:
    ends = tube.entry + np.linspace(0.0, _INTRODUCER, 2)[:, None] * tube.outward
    vertices, faces = draw_tube(ends, np.full(2, tube.bore))
    return Surface(vertices=vertices, faces=faces, name="introducer", color="#8a97a5", opacity=0.35)


def draw_tube(
    points: Floats, radius: Floats, *, sides: int = _SIDES
) -> tuple[Floats, NDArray[np.int64]]:
    """Return rings round a curve (n, 3), joined: open at both ends, outwards."""
    ways = np.gradient(points, axis=0)
    ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-12)
    angles = 2.0 * np.pi * np.arange(sides) / sides
    side = np.eye(3)[np.argmin(np.abs(ways[0]))]
    rings = np.empty((len(points), sides, 3))
    for k, way in enumerate(ways):  # carried along, so that the rings do not twist
        side = side - (side @ way) * way
        side /= np.linalg.norm(side)
        across = np.cross(way, side)
        rings[k] = np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * across
    rings = points[:, None] + radius[:, None, None] * rings
    here = sides * np.arange(len(points) - 1)[:, None] + np.arange(sides)
    after = here + np.where(np.arange(sides) == sides - 1, 1 - sides, 1)
    first = np.stack([here, after, after + sides], axis=-1).reshape(-1, 3)
    second = np.stack([here, after + sides, here + sides], axis=-1).reshape(-1, 3)
    return rings.reshape(-1, 3), np.concatenate([first, second])


def _view_shape(shape: Shape) -> View:
    """Return the backbone of a robot, a step for each shape of a batch, and its tendons."""
    robot = shape.robot
    poses = [shape.world_points, *_place_tendons(shape)]
    chains = [points.reshape(-1, *points.shape[-2:]) for points in poses]
    body = Body(joints=chains[0], radius=robot.radius, name=robot.name)
    tendons = [
        Body(joints=chain, radius=0.06 * robot.radius, name=f"tendon {name}", color=_LINE)
        for name, chain in zip(robot.tendon_names, chains[1:], strict=True)
    ]
    return View(title=f"Robot: {robot.name}", bodies=(body, *tendons))


def _view_history(moved: ShapeHistory) -> View:
    """Return a robot in motion, a step for each time, with speed of the tip and force of walls."""
    base, robot = moved.robot.base_frame, moved.robot
    gaps = np.minimum(moved.gaps[:, 1:], moved.gaps[:, :-1])
    touches = np.isfinite(gaps).any()
    body = Body(
        joints=(moved.points @ base[:3, :3].T + base[:3, 3])[:, ::-1],
        radius=float(max(section.radius for section in robot.sections)),
        clearance=np.where(np.isfinite(gaps), gaps, np.nan)[:, ::-1] if touches else None,
        name=robot.name,
    )
    speed = np.linalg.norm(moved.velocities[:, -1], axis=1)
    forces = (Chart(name="force of walls", unit="N", values=moved.wall_sum, kind="angle"),)
    return View(
        title=f"Robot in motion: {robot.name}, {moved.time[0]:g} to {moved.time[-1]:g} s",
        bodies=(body,),
        charts=(
            Chart(name="time", unit="s", values=moved.time, kind="angle"),
            Chart(name="speed of the tip", unit="mm/s", values=speed, kind="angle"),
            *(forces if touches else ()),
        ),
        scale=None if body.clearance is None else choose_clearance_scale(body.clearance),
    )


def _view_actuation(moved: Actuation) -> View:
    """Return the backbone of a robot that follows a plan, a step for each of its steps."""
    robot = moved.robot
    body = Body(
        joints=moved.place_body(np.arange(moved.steps)),
        radius=robot.radius,
        insertion=moved.head_arc_length,
        name=robot.name,
    )
    return View(title=f"Robot: {robot.name}", bodies=(body,))


def _place_tendons(shape: Shape) -> list[Floats]:
    """Return the tendons (..., n, 3) in the world, as the base stands there."""
    base = shape.robot.base_frame
    return [points @ base[:3, :3].T + base[:3, 3] for points in shape.tendon_points]


def _view_pose(pose: EffectorPose, *, radius: float | None = None) -> View:
    chain = pose.backbone.reshape(-1, *pose.backbone.shape[-2:])
    length = float(np.linalg.norm(np.diff(chain[0], axis=0), axis=1).sum())
    body = Body(joints=chain[:, ::-1], radius=radius or 0.05 * length, name="end-effector")
    return View(title="End-effector", bodies=(body,))


def _view_tips(points: Floats, name: str) -> View:
    return View(title="Workspace", points=(Cloud(points=points, name=name),))


def _view_head(thing: Head | HeadPose) -> View:
    """Return a head, free: camera, end-effectors and instruments, and where their tips can be."""
    head = thing if isinstance(thing, Head) else thing.head
    if isinstance(thing, HeadPose):
        poses = thing.list_poses()
    else:
        poses = [placed.shape(np.zeros((1, 2))) for placed in head.effectors]
    tips = [placed.shape(placed.list_bends(_TIPS)).tip for placed in head.effectors]
    return View(
        title="Distal head",
        bodies=_draw_head(head, poses),
        points=tuple(Cloud(points=each, name="places of the tip") for each in tips),
    )


def _draw_head(
    head: Head, poses: Sequence[SectionPoses], stand: Stand | None = None
) -> tuple[Body, ...]:
    """Return the bodies of a head, free, where it stands."""
    frame, origin = (np.eye(3), np.zeros(3)) if stand is None else (stand.frame, stand.origin)

    def draw(name: str) -> list[Body]:
        if name == "camera":
            color, words = _LINE, ("camera's arm", "camera")
        else:
            color, words = "#4f7cac", (name, name.replace("end-effector", "instrument"))
        return [
            Body(
                joints=origin + chain.lines[:, ::-1] @ frame.T,
                radius=chain.radius,
                name=word,
                color=color,
            )
            for chain, word in zip(named[name], words, strict=False)  # or without an instrument
        ]

    named = list_bodies(head, poses)
    names = [*(name for name in named if name != "camera"), "camera"]  # the first has the slider
    return tuple(body for name in names for body in draw(name))


def _view_reach(found: HeadReach) -> View:
    """Return the wall round a head in colours of its reach, and the head at its target or rest."""
    surfaces = []
    codes = found.codes[found.faces].max(axis=1, initial=0)
    for code, color, name, opacity in (
        (OUT_OF_REACH, "#d9958a", "out of reach", 0.25),
        (BLOCKED, "#b26a00", "in reach, something is in the way", 0.6),
        (REACHED, "#0f7b6c", "reached", 0.85),
    ):
        own = found.faces[codes == code]
        if len(own):
            used, faces = np.unique(own, return_inverse=True)
            surfaces.append(
                Surface(vertices=found.vertices[used], faces=faces.reshape(-1, 3), name=name,
                        color=color, opacity=opacity)
            )  # fmt: skip
    head, stand, row = found.head, found.stand, found.reached_from
    bends = [np.zeros((1, 2)) for _ in head.effectors]
    if row is not None:
        moved = [*head.effectors]
        own = moved[row.effector - 1]
        moved[row.effector - 1] = replace(own, instrument=replace(own.instrument, out=row.out))
        bends[row.effector - 1] = np.array([[row.deflection_x, row.deflection_y]])
        head = replace(head, effectors=tuple(moved))
        stand = replace(stand, frame=stand.roll(row.roll))
    poses = [placed.shape(bend) for placed, bend in zip(head.effectors, bends, strict=True)]
    marks = () if found.target is None else (Mark(place=found.target, text="target", kind="goal"),)
    return View(
        title=f"Reach at {found.insertion:.1f} mm of insertion",
        surfaces=tuple(surfaces),
        bodies=_draw_head(head, poses, stand),
        marks=marks,
    )


def _view_branches(found: TreeReach) -> View:
    """Return a tree as tubes, each place in the colour of the widest scope that gets there."""
    widths = sorted({scope.diameter for scope in found.scopes}, reverse=True)
    shades = ["#0b4f6c", "#0f7b6c", "#5aa469", "#a7c957", "#e9c46a"]
    colors = [shades[min(k, len(shades) - 1)] for k in range(len(widths))]
    parts: dict[tuple[str, str], list[tuple[Floats, NDArray[np.int64]]]] = {}
    for branch in found.tree.branches:
        rows = {row.diameter: row.reached for row in found.rows if row.branch == branch.name}
        arc, begin = measure_arc_length(branch.points), 0.0
        groups = [
            (f"reached with {w:g} mm", c, rows[w]) for w, c in zip(widths, colors, strict=True)
        ]
        for name, color, end in [*groups, ("not reached", REST, branch.length)]:
            if end - begin < 1e-6:
                continue
            own = np.unique(np.concatenate([[begin, end], arc[(arc > begin) & (arc < end)]]))
            line = interpolate_polyline(branch.points, arc, own)
            tube = draw_tube(line, np.interp(own, arc, branch.radius))
            parts.setdefault((name, color), []).append(tube)
            begin = end
    return View(title="Branches that are reached", surfaces=_join_tubes(parts))


def _view_tree(tree: LumenTree) -> View:
    """Return a tree as tubes, a colour for each generation."""
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    shades = colormaps["viridis"](np.linspace(0.0, 0.95, tree.generations))
    parts: dict[tuple[str, str], list[tuple[Floats, NDArray[np.int64]]]] = {}
    for branch in tree.branches:
        key = f"generation {branch.generation}", to_hex(shades[branch.generation])
        parts.setdefault(key, []).append(draw_tube(branch.points, branch.radius))
    return View(title=f"{len(tree.branches)} branches", surfaces=_join_tubes(parts))


def _join_tubes(
    parts: Mapping[tuple[str, str], Sequence[tuple[Floats, NDArray[np.int64]]]],
) -> tuple[Surface, ...]:
    """Return a surface for all tubes of a name and a colour."""
    surfaces = []
    for (name, color), tubes in parts.items():
        counts = np.cumsum([0, *(len(vertices) for vertices, _ in tubes)])
        faces = [faces + count for (_, faces), count in zip(tubes, counts[:-1], strict=True)]
        surfaces.append(
            Surface(
                vertices=np.concatenate([vertices for vertices, _ in tubes]),
                faces=np.concatenate(faces),
                name=name,
                color=color,
                opacity=0.35 if name == "not reached" else 0.9,
            )
        )
    return tuple(surfaces)
