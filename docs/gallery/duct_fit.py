"""A tract as a few round cones.

A measured wall is fitted by cones that lie inside it, so that what is proved in them holds in the
tract, and a distance to the wall takes a fraction of a microsecond.
"""

import bozzini as bz

tract = bz.make_phantom(seed=0).to_labels(voxel=4.0)
fitted = bz.duct.fit(tract, kind="cones")

print(len(fitted.duct.radii), "spheres")
axes = fitted.plot()
