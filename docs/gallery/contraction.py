"""What six models say of one muscle.

Contraction over pressure of a miniature McKibben muscle, 45 mm long. Models without constants to
fit are far apart: measure, then choose.
"""

from bozzini import muscle
from bozzini.plot.muscle import draw_contraction

specimen = muscle.preset("thesis-45")
models = {
    "energy": muscle.EnergyMuscle(specimen),
    "thesis": muscle.ThesisMuscle(specimen),
    "Chou": muscle.Chou(specimen),
    "Gaylord": muscle.GaylordStrain(specimen),
    "Kothera": muscle.KotheraBalance(specimen),
    "Ferraresi": muscle.Ferraresi(specimen),
}
axes = draw_contraction(models, pressure=0.8, lowest=0.1)
axes.legend(loc="lower right", ncols=2)
