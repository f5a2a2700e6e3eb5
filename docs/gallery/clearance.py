"""Where and why it does not fit.

The least distance of each place of the body to the wall over insertion, beside the radius of the
lumen. This scope is refused near the end of the way: the picture marks where.
"""

import bozzini as bz
from bozzini.plot import draw_clearance

tract = bz.make_phantom(seed=7).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=8.0, link_length=10.0))

figure = draw_clearance(plan)
