"""Which model fits my measurements?

A table of contractions is fitted by several models, which are ranked by an information criterion
and by the error on rows that were left out. Here the truth is known: the energy model.
"""

import numpy as np
import pandas as pd

from bozzini import muscle
from bozzini.plot.muscle import draw_ranking

specimen = muscle.preset("effector-45")
pressure = np.linspace(0.1, 0.7, 13)
contraction = muscle.EnergyMuscle(specimen).contraction(pressure)
noise = np.random.default_rng(0).normal(0.0, 0.02, len(pressure))
table = pd.DataFrame(
    {"pressure [MPa]": pressure, "load [N]": 0.0, "contraction [mm]": contraction + noise}
)
some = {
    "energy": muscle.EnergyMuscle,
    "thesis": muscle.ThesisMuscle,
    "tondu-lopez": muscle.TonduLopez,
}
figure = draw_ranking(muscle.rank(table, specimen, models=some))
