"""Pressures that draw a circle.

The exact inverse gives the pressures of the three muscles for each place of the tip.
"""

import bozzini as bz
from bozzini.effector import effector_preset, trace_circle
from bozzini.plot.effector import draw_trace

tip = bz.Effector(effector_preset("prototype"))
trace = trace_circle(tip, 5.0)

print(f"off by {trace.error.max():.1e} mm at most")
figure = draw_trace(trace, tip.design.names)
