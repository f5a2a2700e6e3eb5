"""How likely does it touch?

The wall is known to half a millimetre. How likely the motion touches it somewhere, if places of the
wall much nearer than 10 mm are off by the same, and for which diameters.
"""

import bozzini as bz
from bozzini.study import ContactRiskOptions, study_contact

tract = bz.make_phantom(seed=4).to_labels(voxel=2.0)
field = bz.build_field(tract, voxel=2.0)
line = bz.find_centreline(field)
plan = bz.plan_insertion(field, line, scope=bz.Scope(diameter=9.0, link_length=12.0))

options = ContactRiskOptions(sd=0.5, correlation=10.0, draws=500)
found = study_contact(plan, tract, options=options, duct=field)
figure = found.draw()
