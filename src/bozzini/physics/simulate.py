"""A chain of links in a lumen, stepped by MuJoCo: what all drives and environments share.

A scene is in mm, kg and s, so that forces are in mN; what goes in and out here is in N.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..checks import check_fields, quantity
from ..errors import InputError, MissingExtraError
from ..numeric.arrays import Floats
from ..results import Shown
from .walls import MARGIN_MM, NEWTON, LumenWall

try:
    import mujoco
except ImportError as error:
    raise MissingExtraError((error.name or "mujoco").partition(".")[0], "physics") from None

if TYPE_CHECKING:
    from mujoco import MjData, MjModel, MjSpec

MERGED_MM = 2.5
"""Contacts of a link with prisms that are nearer to each other count once."""

BASE_KG = 1e-3
"""Mass of what the slide moves itself; assumed."""

_LINK, _WALL = 1, 2  # bits of what may touch what
_SIDES = 8  # of the introducer
_UNUSED_MM = 100.0  # depth from which MuJoCo would make a force itself: never


@dataclass(frozen=True, kw_only=True)
class Dynamics(Shown):
    """Masses, gains and the step of a simulation; masses and gains are assumed.

    Parameters
    ----------
    step : float
        Of the integration [s].
    density : float
        Of the body [kg/m^3].
    armature : float
        Inertia of the drive of each joint [kg mm^2].
    damping : float
        Of each joint [N mm s/rad].
    slide_gain, slide_damping : float
        Of the drive that pushes the base in [N/mm], [N s/mm].
    spacing : float
        Between the places of a link's axis that may touch the penalty wall, at most [mm].
    tolerance : float
        Change of the contact forces over the largest of them, at which they are found.

    Raises
    ------
    InputError
        If a value is outside its legal range.
    """

    step: float = quantity("time", "Step of the integration.", default=0.002, low=1e-6, high=0.05)
    density: float = quantity("density", "Of the body.", default=1100.0, low=1.0, high=2e4)
    armature: float = quantity(
        "dimensionless", "Inertia of a joint's drive, in kg mm^2.", default=1.0, low=0.0, high=1e6
    )
    damping: float = field(default=0.02)
    slide_gain: float = quantity("stiffness", "Of the base's drive.", default=50.0, low=1e-3)
    slide_damping: float = field(default=0.1)
    spacing: float = quantity(
        "length", "Between places that may touch.", default=2.5, low=0.1, high=100.0
    )
    tolerance: float = quantity(
        "dimensionless", "Change of forces when found.", default=1e-5, low=1e-12, high=0.1
    )

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Route:
    """A tendon along a chain: by how much each joint makes it longer.

    Parameters
    ----------
    name : str
    arms : (n, 2) float
        Change of its length by the angle of each joint about x and y [mm/rad].
    stiffness : float
        Force by stretch of the whole tendon [N/mm].
    pushes : bool
        Whether it bears compression.
    """

    name: str
    arms: Floats
    stiffness: float
    pushes: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain(Shown):
    """A robot as rigid links on a slide, with a joint of two hinges at the base of each link.

    With twists there is a third hinge, about the link's axis, after the two.

    Parameters
    ----------
    lengths : (n,) float
        Of the links, base first [mm].
    radius : float
        Of the body [mm].
    frame : (4, 4) float
        The base where the slide is at 0, world; z is the way in [mm].
    springs, servos : (n,) float
        Stiffness of each joint, and gain of its servo; 0 without one [N mm/rad].
    servo_damping : float
        Of the servos [N mm s/rad].
    tendons : tuple of Route
    twists : (n,) float, optional
        Torsional stiffness of each joint [N mm/rad]; that of the first is driven, as by a handle.
        Without them the links do not twist.

    Raises
    ------
    InputError
        If arrays do not go together.
    """

    lengths: Floats
    radius: float
    frame: Floats
    springs: Floats
    servos: Floats
    servo_damping: float = 0.9
    tendons: tuple[Route, ...] = ()
    twists: Floats | None = None

    def __post_init__(self) -> None:
        shape = self.lengths.shape
        if len(shape) != 1 or not len(self.lengths) or self.lengths.min() <= 0.0:
            raise InputError(f"lengths have shape {shape}: they must be (n,), positive, n from 1")
        for name in ("springs", "servos") + ("twists",) * (self.twists is not None):
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"{name} has shape {getattr(self, name).shape}: it must be {shape}"
                )

    def to_spec(self, dynamics: Dynamics, wall: LumenWall | None = None) -> MjSpec:
        """Return the scene, in mm, kg and s.

        Damping is larger than what it stands for by stiffness times step: MuJoCo takes damping at
        the end of a step, and so it takes springs and servos there too.
        """
        spec = mujoco.MjSpec()
        spec.comment = "Units: mm, kg, s; forces in mN. Made by Bozzini."
        spec.modelname = "bozzini"
        spec.option.timestep = dynamics.step
        spec.option.gravity = [0.0, 0.0, 0.0]
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = 10.0
        spec.option.ccd_tolerance = 1e-4
        spec.compiler.degree = False
        base = spec.worldbody.add_body(name="base", pos=self.frame[:3, 3], quat=_turn(self.frame))
        self._add_links(spec, base, dynamics)
        for route in self.tendons:
            _add_tendon(spec, route, dynamics)
        if wall is not None and wall.options.kind == "prism":
            _add_prisms(spec, wall)
            _add_guide(spec, wall, float(self.lengths.sum()))
        return spec

    def _add_links(self, spec: MjSpec, base: mujoco.MjsBody, dynamics: Dynamics) -> None:
        step, parent = dynamics.step, base
        base.add_joint(name="slide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
        base.add_geom(
            name="carriage", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[self.radius, 0.0, 0.0],
            mass=BASE_KG, contype=0, conaffinity=0, rgba=[0.5, 0.5, 0.5, 1.0],
        )  # fmt: skip
        gain, damping = NEWTON * dynamics.slide_gain, NEWTON * dynamics.slide_damping
        _add_servo(spec, "slide", gain, damping + step * gain)
        for k, length in enumerate(self.lengths):
            pos = [0.0, 0.0, self.lengths[k - 1] if k else 0.0]
            body = parent.add_body(name=f"link{k}", pos=pos)
            hinges = [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0])]
            # One after the other they twist a little, the other way in the other order.
            turned = (self.tendons or self.twists is not None) and k % 2
            for axis, direction in hinges[:: -1 if turned else 1]:
                _add_hinge(body, f"bend{k}{axis}", direction, dynamics, float(self.springs[k]))
            if self.twists is not None:
                spring = float(self.twists[k]) if k else 0.0
                _add_hinge(body, f"twist{k}", [0.0, 0.0, 1.0], dynamics, spring)
                if not k:
                    gain = NEWTON * float(self.twists[0])
                    _add_servo(spec, "twist0", gain, step * gain)
            if self.servos[k] > 0.0:
                gain = NEWTON * self.servos[k]
                for axis, _ in hinges:
                    damping = NEWTON * self.servo_damping + step * gain
                    _add_servo(spec, f"bend{k}{axis}", gain, damping)
            body.add_geom(
                name=f"skin{k}", type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[0.0, 0.0, 0.0, 0.0, 0.0, length], size=[self.radius, 0.0, 0.0],
                density=1e-9 * dynamics.density, contype=_LINK, conaffinity=_WALL,
                priority=1, rgba=[0.25, 0.4, 0.6, 1.0],
            )  # fmt: skip
            parent = body
        body.add_site(name="tip", pos=[0.0, 0.0, self.lengths[-1]])


def _turn(frame: Floats) -> Floats:
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, np.ascontiguousarray(frame[:3, :3]).ravel())
    return quat


def _add_hinge(
    body: mujoco.MjsBody, name: str, axis: list[float], dynamics: Dynamics, stiffness: float
) -> None:
    spring = NEWTON * stiffness
    joint = body.add_joint(
        name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis, armature=dynamics.armature
    )
    joint.stiffness[0] = spring
    joint.damping[0] = NEWTON * dynamics.damping + dynamics.step * spring


def _add_servo(spec: MjSpec, joint: str, gain: float, damping: float) -> None:
    servo = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.gainprm[0] = gain
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.biasprm[1:3] = -gain, -damping


def _add_tendon(spec: MjSpec, route: Route, dynamics: Dynamics) -> None:
    tendon = spec.add_tendon(name=route.name)
    for k in np.flatnonzero(route.arms.any(axis=1)):
        for axis, arm in zip("xy", route.arms[k], strict=True):
            tendon.wrap_joint(f"bend{k}{axis}", float(arm))
    gain = NEWTON * route.stiffness
    servo = spec.add_actuator(
        name=route.name, target=route.name, trntype=mujoco.mjtTrn.mjTRN_TENDON
    )
    servo.gainprm[0] = gain
    servo.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    servo.biasprm[1:3] = -gain, -(0.002 + dynamics.step) * gain
    if not route.pushes:
        servo.forcelimited = True
        servo.forcerange = [-1e9, 0.0]


def _add_prisms(spec: MjSpec, wall: LumenWall) -> None:
    for k, corners in enumerate(wall.prisms.corners):
        mesh = spec.add_mesh(name=f"wall{k}", uservert=corners.ravel())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        spec.worldbody.add_geom(
            name=f"wall{k}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"wall{k}",
            contype=_WALL, conaffinity=_LINK, rgba=[0.85, 0.58, 0.54, 0.3],
        )  # fmt: skip


def _add_guide(spec: MjSpec, wall: LumenWall, length: float) -> None:
    """Put boxes round the introducer's axis: its inner side, and what closes the cut round it."""
    tube = wall.introducer
    if tube is None:
        return
    from ..numeric.polylines import carry_frames

    axes = carry_frames(tube.outward[None])[0]
    half = 0.5 * max(wall.options.mouth, wall.bore)
    for k in range(_SIDES):
        angle = 2.0 * math.pi * k / _SIDES
        out = math.cos(angle) * axes[:, 0] + math.sin(angle) * axes[:, 1]
        frame = np.eye(4)
        frame[:3, :3] = np.column_stack([out, np.cross(tube.outward, out), tube.outward])
        middle = tube.entry + (wall.bore + half) * out + 0.5 * length * tube.outward
        spec.worldbody.add_geom(
            name=f"guide{k}", type=mujoco.mjtGeom.mjGEOM_BOX, pos=middle, quat=_turn(frame),
            size=[half, 2.0 * (wall.bore + half) * math.tan(math.pi / _SIDES), 0.5 * length],
            contype=_WALL, conaffinity=_LINK, rgba=[0.5, 0.55, 0.6, 0.2],
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Touch:
    """The contacts of a step.

    Parameters
    ----------
    places : (c, 3) float
        World [mm].
    forces : (c, 3) float
        On the body, friction included, world [N].
    normals : (c,) float
        Of each the part across the wall [N].
    depths : (c,) float
        How deep the body is there [mm].
    links : (c,) int
        Which link it is.
    """

    places: Floats
    forces: Floats
    normals: Floats
    depths: Floats
    links: NDArray[np.int64]

    def pick(self, which: NDArray[np.bool_]) -> Touch:
        """Return some of the contacts."""
        return Touch(**{name: values[which] for name, values in vars(self).items()})


_NONE = Touch(
    places=np.zeros((0, 3)),
    forces=np.zeros((0, 3)),
    normals=np.zeros(0),
    depths=np.zeros(0),
    links=np.zeros(0, dtype=np.int64),
)


@dataclass(eq=False)
class Simulation(Shown):
    """A chain in a lumen, under way.

    Parameters
    ----------
    chain : Chain
    wall : LumenWall, optional
        Without one the chain is free.
    dynamics : Dynamics
    """

    chain: Chain
    wall: LumenWall | None = None
    dynamics: Dynamics = Dynamics()
    least: float = math.inf
    """Least clearance of the body's axis in this step, less its radius [mm]."""
    touch: Touch = _NONE
    """The contacts of the last step, but for those in the introducer."""
    work: float = 0.0
    """Work of all drives since the start [N mm]."""
    tightest: Floats = field(default_factory=lambda: np.zeros(3))
    """Where the body's axis has the least clearance [mm]."""

    def __post_init__(self) -> None:
        spec = self.chain.to_spec(self.dynamics, self.wall)
        try:
            self.model: MjModel = spec.compile()
        except ValueError as error:
            raise InputError(f"MuJoCo does not take the scene: {error}") from None
        self.data: MjData = mujoco.MjData(self.model)
        # MuJoCo finds contacts with bodies; the forces are ours, as its stiffness is one per mass.
        bodies = self.model.geom_contype == _WALL
        self.model.geom_margin[bodies] = -_UNUSED_MM
        self.model.geom_gap[bodies] = _UNUSED_MM + 4.0 * MARGIN_MM
        mujoco.mj_forward(self.model, self.data)
        self._bodies = self._samples[0] + 2
        count = len(self._bodies)
        self._index = np.zeros(count, dtype=np.int64)
        self._depth = np.zeros(count)
        self._normal = np.zeros((count, 3))
        self._points = np.empty((count, 3))
        self._used = np.zeros(0, dtype=np.int64)
        self.unsettled = 0  # steps whose contact forces did not come to rest
        pairs = len(self.chain.lengths) * self.model.ngeom if bodies.any() else count
        self._before = np.zeros((pairs, 3))
        self._mass = np.zeros((self.model.nv, self.model.nv))
        self._find_damping()

    @cached_property
    def _samples(self) -> tuple[NDArray[np.int64], Floats]:
        """Link and place along it of the samples of the body's axis, tip last."""
        links, along = [], []
        for k, length in enumerate(self.chain.lengths):
            count = max(1, math.ceil(length / self.dynamics.spacing))
            links += [k] * count
            along += (length * np.arange(count) / count).tolist()
        links.append(len(self.chain.lengths) - 1)
        along.append(float(self.chain.lengths[-1]))
        return np.array(links), np.array(along)

    @property
    def joints(self) -> Floats:
        """Joints (n + 1, 3) in the world, the tip first as in a plan [mm]."""
        return np.concatenate([self.data.xpos[2:], self.tip[None]])[::-1].copy()

    @property
    def tip(self) -> Floats:
        """Where the tip is (3,), world [mm]."""
        return np.asarray(self.data.site_xpos[-1])

    @property
    def tip_frame(self) -> Floats:
        """Rotation (3, 3) of the last link; its z is the way ahead."""
        return np.asarray(self.data.xmat[-1]).reshape(3, 3).copy()

    @property
    def twist(self) -> float:
        """Angle of the tip about its axis, in (-pi, pi] [rad].

        Against the base's frame, carried along the links by the least turn from each to the next.
        """
        frame = self.chain.frame[:3, :3]
        across, before = frame[:, 0], frame[:, 2]
        for way in np.asarray(self.data.xmat[2:]).reshape(-1, 3, 3)[:, :, 2]:
            across = across - (across @ way) / (1.0 + before @ way) * (before + way)
            before = way
        x, y = self.tip_frame[:, 0], self.tip_frame[:, 1]
        return math.atan2(-float(across @ y), float(across @ x))

    @property
    def torque(self) -> float:
        """Of the handle at the end of the last step [N mm]; 0 for a chain without twist."""
        if self.chain.twists is None:
            return 0.0
        return float(self._drive_forces(self._drive_rates())[1]) / NEWTON

    @property
    def inserted(self) -> float:
        """How far the base has been moved in [mm]."""
        return float(self.data.qpos[0])

    @property
    def push_force(self) -> float:
        """Force of the drive that pushes the base in, at the end of the last step [N]."""
        return float(self._drive_forces(self._drive_rates())[0]) / NEWTON

    def _drive_rates(self) -> Floats:
        """Return how fast the drives (u,) move: joints, then tendons."""
        rates = self.data.qvel
        joints = np.asarray(rates[self._driven])
        return np.concatenate([joints, self._arms @ rates]) if len(self._arms) else joints

    def _drive_forces(self, rates: Floats) -> Floats:
        """Return the forces of the drives (u,), with what damping took from them in the step."""
        data = self.data
        change = rates - data.actuator_velocity
        return np.where(data.actuator_force == 0.0, 0.0, data.actuator_force - self._yield * change)

    def place(self, positions: Floats) -> None:
        """Put the slide and the hinges (v,) somewhere, at rest, and begin anew."""
        mujoco.mj_resetData(self.model, self.data)
        self.touch, self.least, self.work = _NONE, math.inf, 0.0
        self.unsettled = 0
        self._before[:] = 0.0
        self.data.qpos[:] = positions
        mujoco.mj_forward(self.model, self.data)

    def step(self, control: Floats, rates: Floats | None = None) -> None:
        """Make one step.

        Parameters
        ----------
        control : (u,) float
            Where each drive is to be at the end of the step: slide [mm], hinges [rad], by how much
            tendons are longer than in the straight chain [mm].
        rates : (u,) float, optional
            How fast it moves then, against which the servo's damping acts.
        """
        model, data, step = self.model, self.data, self.dynamics.step
        if rates is not None:
            gains = model.actuator_gainprm[:, 0]
            damping = -model.actuator_biasprm[:, 2] - step * gains
            control = control + damping / gains * rates
        data.ctrl[:] = control
        data.qfrc_applied[:] = 0.0
        mujoco.mj_step1(model, data)
        if self.wall is not None:
            self._press(self.wall)
        mujoco.mj_step2(model, data)
        moved = self._drive_rates()
        self.work += step * float(self._drive_forces(moved) @ moved) / NEWTON
        if data.warning.number.any():
            self._refuse()

    @property
    def is_compiled(self) -> bool:
        """Whether `advance` knows how to step it: a penalty wall, neither tendons nor twists."""
        penalty = self.wall is not None and self.wall.options.kind == "penalty"
        return penalty and not self.chain.tendons and self.chain.twists is None

    def advance(self, start: Floats, goal: Floats, *, count: int) -> float:
        """Make steps in which the drives (u,) go evenly from one place to another, in one call.

        They are those of `step`, by a compiled kernel instead of MuJoCo where `is_compiled`; that
        does not list the contacts.

        Returns
        -------
        float
            Sum of the normal forces of the last step, but for those in the introducer [N].
        """
        step = self.dynamics.step
        if not self.is_compiled:
            rates = (goal - start) / (count * step)
            for k in range(1, count + 1):
                self.step(start + k / count * (goal - start), rates)
            return float(self.touch.normals.sum())
        from .kernels.dynamics import advance_chain

        chain, drives, state, scene, law, memory = self._kept
        pressed, least, where, unsettled, work, made = advance_chain(
            self.packed_wall, chain, drives, (start, goal, count), state, scene, law, memory
        )
        self.least, self.tightest = least - self.chain.radius, self._points[where].copy()
        self.unsettled += unsettled
        self.work += work / NEWTON
        self.data.time += made * step
        if made < count:
            self._refuse()
        return float(pressed) / NEWTON

    @cached_property
    def _kept(self) -> tuple[tuple[object, ...], ...]:
        """What `advance_chain` takes, the arrays of MuJoCo's data among it, but for the motion."""
        model, data, chain, step = self.model, self.data, self.chain, self.dynamics.step
        gains, options = model.actuator_gainprm[:, 0].copy(), self._given_wall.options
        springs = np.append(0.0, NEWTON * np.repeat(chain.springs, 2))
        stiffness = NEWTON * options.stiffness
        law = stiffness, stiffness * options.damping, options.friction, step
        return (
            (
                np.ascontiguousarray(chain.frame), chain.lengths, model.body_mass[1:].copy(),
                model.body_ipos[2:, 2].copy(), model.body_inertia[2:, 0].copy(),
                model.body_inertia[2:, 2].copy(),
            ),
            (
                springs, model.dof_damping.copy(), model.dof_armature + self._damping,
                self._driven.astype(np.int64), gains, self._yield, self._yield / gains - step,
            ),
            (data.qpos, data.qvel),
            (data.xpos, data.xmat, data.xaxis, data.xanchor, data.site_xpos),
            ((*law, self.dynamics.tolerance), chain.radius, MARGIN_MM),
            (self._bodies, self._samples[1], self._points, self._before),
        )  # fmt: skip

    def _refuse(self) -> None:
        raise InputError(
            f"the simulation is not stable at {self.data.time:.3f} s: take a smaller step than "
            f"{self.dynamics.step:g} s"
        )

    def _press(self, wall: LumenWall) -> None:
        """Measure the clearance, and apply the force of the penalty wall."""
        from .kernels.contact import find_contacts

        data = self.data
        margin = MARGIN_MM + 2.0 * self.dynamics.step * abs(float(data.qvel[0]))
        count, least, where = find_contacts(
            self.packed_wall, (data.xpos, data.xmat), (self._bodies, self._samples[1]),
            self._points, (self.chain.radius, margin), self._index, self._depth, self._normal,
        )  # fmt: skip
        self.least, self.tightest = least - self.chain.radius, self._points[where].copy()
        self.touch = _NONE
        if wall.options.kind == "prism":
            self._balance(*self._list_contacts())
        elif count:
            normals = self._normal[:count] @ self.packed_wall[2][:3].T
            index = self._index[:count].copy()
            self._balance(
                self._points[index] - self.chain.radius * normals,
                normals,
                self._depth[:count].copy(),
                self._samples[0][index],
                index,
            )

    def _list_contacts(self) -> tuple[Floats, Floats, Floats, NDArray[np.int64], NDArray[np.int64]]:
        """Return the contacts with bodies of the wall: places, normals, depths, links, keys."""
        from .kernels.contact import merge_contacts

        contact, model = self.data.contact, self.model
        geoms = np.asarray(contact.geom).reshape(-1, 2)
        bodies = model.geom_bodyid[geoms]
        ahead = np.where(bodies[:, 1] > 0, 1.0, -1.0)  # normals are towards the second body
        places = np.ascontiguousarray(contact.pos).reshape(-1, 3)
        normals = ahead[:, None] * np.asarray(contact.frame).reshape(-1, 9)[:, :3]
        depths = -np.asarray(contact.dist)
        links = bodies.max(axis=1).astype(np.int64) - 2
        keys = links * model.ngeom + np.where(bodies[:, 1] > 0, geoms[:, 0], geoms[:, 1])
        kept = np.zeros(len(links), dtype=np.bool_)
        order = np.argsort(-depths, kind="stable")
        merge_contacts(order, places, normals, links, MERGED_MM, kept)
        return places[kept], normals[kept], depths[kept], links[kept], keys[kept]

    @property
    def _given_wall(self) -> LumenWall:
        if self.wall is None:
            raise InputError("there is no wall")
        return self.wall

    @cached_property
    def packed_wall(self) -> tuple[object, Floats, Floats]:
        """The duct and the introducer as kernels take them, and the frame (4, 3) of the duct."""
        wall = self._given_wall
        origin = wall.duct.to_grid(np.zeros(3))
        frame = np.vstack([wall.duct.to_grid(np.eye(3)) - origin, origin])
        return wall.duct.pack(), wall.tube, frame

    def look(self, axes: Floats, *, pixels: int, lens: tuple[float, float, float]) -> Floats:
        """Return what a camera at the tip sees of the wall, lit from there, (n, n) in [0, 1].

        Parameters
        ----------
        axes : (3, 3) float
            Right, down and ahead as columns, world.
        pixels : int
        lens : tuple
            Half the angle of view [rad], and the distances up to which the light is full and at
            which it ends [mm].

        Raises
        ------
        InputError
            If there is no wall.
        """
        from .kernels.contact import look_ahead

        image = np.empty((pixels, pixels))
        lens = math.tan(lens[0]), *lens[1:]
        look_ahead(self.packed_wall, self.tip, np.ascontiguousarray(axes), lens, image)
        return image

    def _balance(
        self,
        places: Floats,
        normals: Floats,
        depths: Floats,
        links: NDArray[np.int64],
        keys: NDArray[np.int64],
    ) -> None:
        """Find the forces of the wall at the end of the step, and apply them.

        Those of a contact begin as they were in the step before: `keys` say which is which.
        """
        from .kernels.contact import press_contacts

        model, data, wall = self.model, self.data, self.wall
        count = len(links)
        if wall is None or not count:
            return
        options = wall.options
        force, frames = self._before[keys], np.empty((count, 3, 3))
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        stiffness, dynamics = NEWTON * options.stiffness, self.dynamics
        law = stiffness, stiffness * options.damping, options.friction, dynamics.step
        data.qfrc_applied[:], settled = press_contacts(
            self._weigh(), (data.qvel, data.qfrc_smooth), (data.xaxis, data.xanchor),
            (places, normals, depths, self._moving[links]),
            (*law, dynamics.tolerance), force, frames,
        )  # fmt: skip
        self.unsettled += not settled
        self._before[self._used] = 0.0
        self._before[keys], self._used = force, keys
        on = force[:, 0] > 0.0
        on &= ~wall.is_introducer(places)
        if not on.any():
            return
        force = force[on] / NEWTON
        self.touch = Touch(
            places=places[on],
            forces=np.einsum("ck,ckx->cx", force, frames[on]),
            normals=force[:, 0],
            depths=depths[on],
            links=links[on],
        )

    def _weigh(self) -> Floats:
        """Return the mass matrix with what damping adds over a step: what MuJoCo inverts."""
        model, data, mass = self.model, self.data, self._mass
        mujoco.mj_fullM(model, data, mass)
        mass.ravel()[:: model.nv + 1] += self._damping
        if len(self.chain.tendons):
            taut = data.actuator_force[-len(self._arms) :] != 0.0
            arms = self._arms[taut]
            mass += arms.T @ (self._sheath[taut, None] * arms)
        return mass

    def _find_damping(self) -> None:
        """Find what joints, servos and tendons add to the mass over a step."""
        model, step = self.model, self.dynamics.step
        damping = -model.actuator_biasprm[:, 2]
        joints = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
        self._yield = damping
        hinges = 2 if self.chain.twists is None else 3
        self._moving = 1 + hinges * np.arange(1, len(self.chain.lengths) + 1)
        self._driven = model.actuator_trnid[joints, 0]
        self._damping = step * model.dof_damping
        self._damping[model.actuator_trnid[joints, 0]] += step * damping[joints]
        self._sheath = step * damping[~joints]
        self._arms = np.zeros((len(self.chain.tendons), model.nv))
        for k, route in enumerate(self.chain.tendons):
            for axis, arms in zip("xy", route.arms.T, strict=True):
                for j, arm in enumerate(arms):
                    self._arms[k, model.joint(f"bend{j}{axis}").dofadr[0]] = arm
