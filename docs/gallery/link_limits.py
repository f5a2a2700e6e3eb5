"""How long may a link be?

At each place of the tract, the longest rigid link of a 9 mm scope that gets round the bend.
"""

import bozzini as bz
from bozzini.motion import find_link_limits
from bozzini.plot.duct import draw_link_limits

tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)

limits = find_link_limits(field, line, diameter=9.0)
figure = draw_link_limits(limits, link=12.0)
