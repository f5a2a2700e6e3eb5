"""A certified motion.

A scope is planned into a phantom of the upper tract. The picture shows it at three depths and how
far its whole body stays from the wall.
"""

import bozzini as bz
from bozzini.plot import draw_overview

tract = bz.make_phantom(seed=0).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=9.0, link_length=12.0))

print(f"{plan.inserted:.0f} mm in, at least {plan.certificate.clearance:.2f} mm from the wall")
figure = draw_overview(plan, field)
