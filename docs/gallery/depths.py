"""A motion as an endoscopist's X-ray.

The same plan at five depths, from the front and from the side.
"""

import bozzini as bz
from bozzini.plot import draw_depths

tract = bz.make_phantom(seed=4).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=9.0, link_length=12.0))

figure = draw_depths(plan, field)
