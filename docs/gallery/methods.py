"""Three planners beside each other.

The thesis's scheme constrains the joints and lets links cut the wall in tight bends. `follow` drags
the body behind the head. The default keeps the whole body inside, and proves it.
"""

import bozzini as bz
from bozzini.plot import draw_comparison

tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
scope = bz.Scope(diameter=9.0, link_length=20.0)
plans = [
    bz.plan_insertion(field, line, scope=scope, method=method)
    for method in ("best", "follow", "thesis")
]

figure = draw_comparison(plans)
