"""Plans damaged on purpose, and a brute force that says what of a plan is not so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bozzini.motion.recheck import EntryTube, recheck_motion, voxel_wall
from tests.exact import sample_body
from tests.motion.plans import describe_anew, insert
from tests.motion.planted import plant

VARIANTS = (
    {},
    {"method": "follow"},
    {"head_step": 1.0},
    {"route": (1.0, 0.2)},
    {"method": "follow", "route": (0.7, 0.0, 0.9), "head_step": 0.7},
    {"method": "thesis", "head_step": 0.5},
    {"slip": 0.5, "head_step": 0.5},
    {"thin": 0.6},
    {"thin": 0.8, "method": "follow", "head_step": 0.5},
)


class Planted:
    """A planted tube, its exact wall, and plans through it."""

    def __init__(self, seed):
        tube = plant(seed)
        self.field, self.line, self.scope = tube.field, tube.line, tube.scope
        affine = np.eye(4)
        affine[:3, :3] = tube.wall.turn * tube.wall.scale
        affine[:3, 3] = tube.wall.origin
        self.wall = voxel_wall(tube.wall.mask, affine)

    def plan(self, *, thin=1.0, **options):
        scope = replace(self.scope, diameter=thin * self.scope.diameter)
        return insert(self.field, self.line, scope=scope, **options)


def read_tube(plan):
    """The introducer as the second checker takes it."""
    stated = plan.introducer
    return EntryTube(entry=stated.entry, outward=stated.outward, bore=stated.bore)


def recheck(plan, wall, **options):
    """The second check of a plan against its wall at rest."""
    return recheck_motion(
        plan.joints,
        wall,
        radius=0.5 * plan.scope.diameter,
        tube=read_tube(plan),
        inflation=plan.field.inflation,
        **options,
    )


def sample_clearance(plan, wall, count, random):
    """Exact clearances of random body points that are not in the introducer."""
    points, *_ = sample_body(plan.joints, count, random)
    radius, tube = 0.5 * plan.scope.diameter, read_tube(plan)
    points = points[~tube.holds(points, radius)]
    return wall.measure_clearance(points) + plan.field.inflation - radius


def find_wrong(plan, wall):
    """What is not so in a plan that says it is certified: "" if nothing is."""
    meta = plan.meta
    length, step = meta["scope"]["link_length_mm"], meta["head_step_mm"]
    heads, joints = plan.head_arc_length, plan.joints
    if np.abs(np.linalg.norm(np.diff(joints, axis=1), axis=2) - length).max() > 1e-3:
        return "links"
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(plan.path, axis=0), axis=1))])
    place = np.stack([np.interp(heads, arc, column) for column in plan.path.T], axis=1)
    if np.linalg.norm(joints[:, 0] - place, axis=1).max() > 1e-2:
        return "head"
    if np.abs(np.diff(heads)).max(initial=0.0) > step + 1e-3:
        return "head step"
    turns = np.sign(np.diff(heads)[np.abs(np.diff(heads)) > 1e-3])
    if np.count_nonzero(np.diff(turns)) > len(meta["options"]["route"]) - 1:
        return "order"
    moves = np.linalg.norm(np.diff(joints, axis=0), axis=2)
    if moves.max(initial=0.0) > meta["measures"]["joint_step_max_mm"] + 1e-3:
        return "jump"
    goal = max(meta["options"]["route"]) * arc[-1]
    if plan.status == "complete" and heads.max() < goal - 0.01:
        return "status"
    second = recheck(plan, wall)
    if second.found < 0.0:
        return "wall"
    if meta["certified"] and meta["certificate"]["clearance_mm"] > second.found + 1e-6:
        return "claim"
    return ""


def damage(plan, random):
    """Return a plan with one thing changed, and what that was."""
    joints, heads, clearance = (
        plan.joints.copy(),
        plan.head_arc_length.copy(),
        plan.clearance.copy(),
    )
    meta = {key: dict(v) if isinstance(v, dict) else v for key, v in plan.meta.items()}
    steps, count, _ = joints.shape
    step, joint = int(random.integers(1, steps)), int(random.integers(0, count))
    size = float(np.exp(random.uniform(np.log(1e-3), np.log(20.0))))
    way = random.normal(size=3)
    way *= size / np.linalg.norm(way)
    changes = {}
    kind = str(random.choice(KINDS))
    if kind == "joint":
        joints[step, joint] += way
    elif kind == "joint for good":
        joints[step:, joint] += way
    elif kind == "chain":
        joints[step] += way
    elif kind == "chain for good":
        joints[step:] += way
    elif kind == "all":
        joints += way
    elif kind == "all and path":
        joints += way
        changes["path"] = plan.path + way
        entry = np.array(meta["introducer"]["entry_mm"]) + way
        meta["introducer"]["entry_mm"] = entry.tolist()
    elif kind == "bend":  # all links keep their length
        turn = np.linalg.qr(np.eye(3) + 0.05 * size * random.normal(size=(3, 3)))[0]
        hinge = joints[step:, joint : joint + 1]
        joints[step:, joint:] = hinge + (joints[step:, joint:] - hinge) @ turn.T
    elif kind == "stretch":
        tail = joints[:, joint:] - joints[:, :1]
        joints[:, joint:] = joints[:, :1] + tail * (1.0 + 0.01 * size)
    elif kind == "swap":
        other = int(random.integers(1, steps))
        for array in (joints, heads, clearance):
            array[[step, other]] = array[[other, step]]
    elif kind == "drop":
        gone = slice(step, step + int(random.integers(1, 30)))
        joints, heads, clearance = (np.delete(a, gone, axis=0) for a in (joints, heads, clearance))
    elif kind == "cut":
        joints, heads, clearance = (a[: step + 1] for a in (joints, heads, clearance))
    elif kind == "shorter scope":
        keep = max(2, joint)
        joints, clearance = joints[:, :keep], clearance[:, : keep - 1]
    elif kind == "radius":
        meta["scope"]["diameter_mm"] += size
    elif kind == "claim":
        meta["certificate"]["clearance_mm"] = (meta["certificate"]["clearance_mm"] or 0.0) + size
        meta["certified"] = True
        if random.random() < 0.5:
            clearance += size
            meta["measures"]["clearance_min_mm"] = float(clearance.min())
    elif kind == "status":
        keep = slice(0, step + 1)
        joints, heads, clearance = joints[keep], heads[keep], clearance[keep]
        changes |= {"status": "complete", "reason_code": "", "reason": ""}
        if random.random() < 0.5:
            heads = heads / max(heads.max(), 1e-9) * plan.path_arc_length[-1]
    elif kind == "bore":
        meta["introducer"]["bore_mm"] += size
    elif kind == "introducer":
        entry = np.array(meta["introducer"]["entry_mm"]) + way
        meta["introducer"]["entry_mm"] = entry.tolist()
    elif kind == "introducer turned":
        outward = np.array(meta["introducer"]["outward"]) + 0.3 * way
        meta["introducer"]["outward"] = (outward / np.linalg.norm(outward)).tolist()
    elif kind == "introducer in the tract":
        meta["introducer"]["outward"] = (-np.array(meta["introducer"]["outward"])).tolist()
        joints[:] = np.array(meta["introducer"]["entry_mm"]) + np.arange(count)[:, None] * (
            np.array(meta["introducer"]["outward"]) * meta["scope"]["link_length_mm"]
        )
    elif kind == "inflation":
        meta["field"]["inflation_mm"] += size
    elif kind == "not finite":
        bad = float(random.choice([np.nan, np.inf, -np.inf]))
        array = [joints, heads, clearance][int(random.integers(3))]
        array.flat[int(random.integers(array.size))] = bad if array is not clearance else np.nan
    elif kind == "plane":
        joints = joints[..., :2]
    changes |= {"joints": joints, "head_arc_length": heads, "clearance": clearance}
    return kind, replace(describe_anew(plan, meta), **changes)


KINDS = (
    "joint",
    "joint for good",
    "chain",
    "chain for good",
    "all",
    "all and path",
    "bend",
    "stretch",
    "swap",
    "drop",
    "cut",
    "shorter scope",
    "radius",
    "claim",
    "status",
    "bore",
    "introducer",
    "introducer turned",
    "introducer in the tract",
    "inflation",
    "not finite",
    "plane",
)
