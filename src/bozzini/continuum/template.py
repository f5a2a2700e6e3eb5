"""A robot file to start from: commented, and ready to run."""

from __future__ import annotations

from ..checks import check_integer, list_quantities
from .section import Section, Tendon

HEAD = """\
# A tendon-driven continuum robot. Units may be left out: mm, N, MPa and rad then; angles beyond
# a full turn need theirs. A line that begins with '#' and a name is a field at rest.
#   bozzini continuum pose {file} {option}
name: robot
#base_position: [0 mm, 0 mm, 0 mm] # of the base in the world, mm; weight acts along -z
#base_rotation: [0 deg, 90 deg, 0 deg] # rotation vector, deg or rad
sections: # from base to tip
"""

SECTION = """\
  - length: 60 mm # {length}
    radius: {radius_mm:g} mm # {radius}
    discs: 10 # {discs}; evenly spaced, the last at the end
    # EI, constant or knots such as [[0 mm, 200 N mm^2], [60 mm, 100 N mm^2]]; in place of both
    # stiffnesses, wire: {{diameter: 1 mm, modulus: 60 GPa, density: 6450 kg/m^3}}
    bending_stiffness: 200 N mm^2 # {bending_stiffness}
    #torsional_stiffness: 154 N mm^2 # {torsional_stiffness}; EI / 1.3 if left out
    #stretch_stiffness: 10 kN # {stretch_stiffness}; does not stretch if left out
    #shear_stiffness: 4 kN # {shear_stiffness}; does not shear if left out
    #curvature: [0 rad/mm, 0 rad/mm, 0 rad/mm] # {curvature}; about x and y, and twist
    #line_weight: 0.1 N/m # {line_weight}
    #disc_weight: 1 mN # {disc_weight}
    max_bend: 120 deg # {max_bend}
"""

TENDONS = "    tendons: # those that end in this section\n"

TENDON = "      - {{name: {name}, offset: {offset:g} mm, angle: {angle:.10g} deg}}\n"

MORE = """\
      # offset: {offset}; at most the radius. angle: {angle}.
      # A tendon also takes, after a comma:
      #   travel: [-8 mm, 8 mm]  {travel}
      #   stiffness: 10 kN       {stiffness}; does not stretch if left out
      #   pretension: 1 N        {pretension}; with a stiffness
      #   tension_limit: 20 N    {tension_limit}
      #   friction: 0.1          {friction}
      #   pushes: true           a rod, which pushes as well
"""

MOST_SECTIONS = 20
MOST_TENDONS = 12

RADIUS_MM = 6.0
OFFSET_MM = 4.0


def suggest_option(tendons: int) -> str:
    """Return an option of ``pose`` for a robot with so many tendons in each section."""
    return "--displacement T1=2mm" if tendons else "--load force=0:10mN:0"


def write_template(*, sections: int = 2, tendons: int = 3, file: str = "robot.yaml") -> str:
    """Return the text of a robot file with comments, which `ContinuumRobot.from_yaml` reads.

    Parameters
    ----------
    sections : int
        Number of sections, in [1, 20].
    tendons : int
        Tendons that end in each section, evenly about the backbone, in [0, 12].
    file : str
        Name of the file, for the command in its first lines.

    Raises
    ------
    InputError
        If a number is outside its range.
    """
    count = check_integer("sections", sections, low=1, high=MOST_SECTIONS)
    each = check_integer("tendons", tendons, low=0, high=MOST_TENDONS)
    name = file if file.isprintable() else "ROBOT.yaml"
    text = HEAD.format(file=name, option=suggest_option(each))
    for index in range(count):
        text += SECTION.format(radius_mm=RADIUS_MM, **_describe(Section))
        text += TENDONS if each else ""
        for k in range(each):
            # Those of one section stand between those of the one before.
            angle = 360.0 / each * (k + index / count)
            text += TENDON.format(name=f"T{index * each + k + 1}", offset=OFFSET_MM, angle=angle)
        text += MORE.format(**_describe(Tendon)) if index == 0 and each else ""
    return text


def _describe(kind: type) -> dict[str, str]:
    return {name: known.describe() for name, known in list_quantities(kind).items()}
