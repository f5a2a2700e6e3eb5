"""A duct of your own shapes.

Signed distance to a union of cones, as a slice. Anything with a signed distance can be planned
through.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.duct import RoundCones, Union

turn = np.linspace(0.0, np.pi, 9)
bend = np.stack([30.0 * np.cos(turn), np.zeros(9), 30.0 * np.sin(turn)], axis=1)
limb = np.array([[30.0, 0.0, -50.0], [30.0, 0.0, 0.0]])
duct = Union((RoundCones(bend, np.linspace(8.0, 12.0, 9)), RoundCones(limb, [6.0, 8.0])))

x, z = np.meshgrid(np.linspace(-50.0, 50.0, 200), np.linspace(-60.0, 50.0, 220))
distance = duct.signed_distance(np.stack([x, 0.0 * x, z], axis=-1))
figure, axes = plt.subplots(layout="constrained")
filled = axes.contourf(x, z, distance, levels=20, cmap="RdBu", vmin=-40.0, vmax=40.0)
axes.contour(x, z, distance, levels=[0.0], colors="k")
axes.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
figure.colorbar(filled, label="signed distance [mm]")
