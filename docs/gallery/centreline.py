"""The centreline of a tract.

The way that stays far from the wall, with the radius of the largest ball at each station.
"""

import bozzini as bz

tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)

print(f"{line.length:.0f} mm long, narrowest radius {line.radius.min():.1f} mm")
axes = line.plot()
