"""What another package adds to Bozzini: a planner, a duct, a muscle and a continuum model.

``pip install examples/plugin`` installs it; ``pyproject.toml`` beside this file names the classes
by entry points. Bozzini's commands then list them beside its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bozzini.checks import check_fields, check_range, list_quantities, quantity
from bozzini.continuum import ParallelModel
from bozzini.duct.base import DuctShape
from bozzini.motion import Motion, Planner, move_free_chain
from bozzini.muscle import Muscle, MuscleModel
from bozzini.muscle.design import PRESSURE_LIMIT
from bozzini.muscle.model import take_arguments
from bozzini.progress import no_progress


class PulledPlanner(Planner):
    """The head follows the centreline and pulls the links behind it, whatever the wall.

    The plan's certificate states what clearance that leaves, or that there is none.
    """

    name = "pulled"
    ignored = ("angle_limit", "route")

    def move(self, space, scope, *, options, progress=no_progress):
        """Return the tractrix of the centreline."""
        line = space.centreline
        steps = int(np.ceil(line.length / options.head_step))
        travelled = np.linspace(0.0, line.length, steps + 1)
        heads = [np.interp(travelled, line.arc_length, column) for column in line.points.T]
        chain = space.tube.place_chain(scope.count_links(line.length) + 1, scope.link_length)
        joints = move_free_chain(chain, np.stack(heads, axis=1), slip=options.slip)
        return Motion(joints=joints, head_arc_length=travelled, path=line.points)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ring(DuctShape):
    """The inside of a torus about the z axis."""

    name = "ring"

    radius: float = quantity("length", "From the axis to the middle of the tube.", low=1.0)
    tube: float = quantity("length", "Radius of the tube.", low=0.0, low_open=True)

    @property
    def bounds(self):
        """Corners of the box that holds the ring."""
        wide = self.radius + self.tube + self.inflation
        corner = np.array([wide, wide, self.tube + self.inflation])
        return np.stack([-corner, corner])

    def signed_distance(self, points):
        """Return the exact distance to the wall, negative inside."""
        x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        return np.hypot(np.hypot(x, y) - self.radius, z) - self.tube - self.inflation


@dataclass(frozen=True)
class SpringMuscle(MuscleModel):
    """``force = spring (gain P - contraction)``: the muscle's length is a limit only."""

    muscle: Muscle
    spring: float = quantity("stiffness", "Stiffness.", low=0.0, low_open=True, default=2.0)
    gain: float = quantity(help="Free contraction over pressure [mm/MPa].", low=0.0, default=12.0)

    name = "spring"
    unused = tuple(field for field in list_quantities(Muscle) if field != "length")
    fit_fields = ("spring", "gain")  # what a fit frees: nothing of the muscle would matter

    def __post_init__(self):
        """Check the numbers."""
        check_fields(self)

    def force(self, pressure, contraction, *, direction=None):
        """Return the pull [N]."""
        limits = -self.muscle.length, self.muscle.length
        pressures, held, _ = take_arguments(
            pressure, ("contraction", contraction), direction, most=PRESSURE_LIMIT, limits=limits
        )
        return self.spring * (self.gain * pressures - held)

    def contraction(self, pressure, load=0.0, *, direction=None):
        """Return the contraction [mm]."""
        pressures, loads, _ = take_arguments(
            pressure, ("load", load), direction, most=PRESSURE_LIMIT
        )
        found = self.gain * pressures - loads / self.spring
        length = self.muscle.length
        check_range("contraction", found, -length, length, "mm")
        return found

    def stiffness(self, pressure, contraction, *, direction=None):
        """Return the spring's stiffness [N/mm]: exact, where the default is a difference."""
        return np.full_like(self.force(pressure, contraction), self.spring)


@dataclass(frozen=True)
class RigidDiscModel(ParallelModel):
    """Each section a chain of equal rigid pieces that bend at the discs between them."""

    name = "rigid-discs"

    def shape(self, displacements):
        """Return the shapes under tendon displacements."""
        found = self.solve(displacements)
        stations = self.robot.stations()
        owner = self.robot.section_at(stations[1:])
        lengths = np.array([section.length for section in self.robot.sections])[owner]
        frames = [np.broadcast_to(np.eye(4), (*found.bends.shape[:-2], 4, 4))]
        for k, piece in enumerate(np.diff(stations)):
            half = 0.5 * found.bends[..., owner[k], :] * (piece / lengths[k])[..., None]
            turn = _turn(half)
            ahead = np.zeros((*half.shape[:-1], 4, 4))
            ahead[..., :3, :3] = turn @ turn
            ahead[..., :3, 3] = piece * turn[..., :, 2]
            ahead[..., 3, 3] = 1.0
            frames.append(frames[-1] @ ahead)
        return self.answer(found, arc_length=stations, frames=np.stack(frames, axis=-3))


def _turn(bend):
    """Return the rotation by a bend ``theta (cos(phi), sin(phi))``: z leans towards phi."""
    from scipy.spatial.transform import Rotation

    vector = np.stack([-bend[..., 1], bend[..., 0], np.zeros(bend.shape[:-1])], axis=-1)
    return Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix().reshape(*bend.shape[:-1], 3, 3)
