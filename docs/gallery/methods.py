"""Three planners beside each other.

The thesis's scheme constrains the joints and lets links cut the wall in tight bends. `follow` keeps
all joints on the path of the head, `tube` moves them freely in a tube about it; both keep the whole
body inside, and prove it. The default takes the one with the most certified clearance.
"""

import bozzini as bz
from bozzini.plot import draw_comparison

tract = bz.make_phantom(seed=4).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
scope = bz.Scope(diameter=9.0, link_length=30.0)
plans = [
    bz.plan_insertion(field, line, scope=scope, method=method)
    for method in ("tube", "follow", "thesis")
]

figure = draw_comparison(plans)
