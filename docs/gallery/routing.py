"""Tendons routed to hold an S.

One tendon on a designed path holds a robot in an S by its tension alone.
"""

import numpy as np

from bozzini.motion.routing import design_routing
from bozzini.plot.routing import draw_design

s = np.linspace(0.0, 120.0, 601)
turn = 0.9 * np.sin(2.0 * np.pi * s / 120.0)
ways = np.stack([np.sin(turn), np.zeros_like(s), np.cos(turn)], axis=1)
steps = 0.5 * (ways[1:] + ways[:-1]) * np.diff(s)[:, None]
curve = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])

design = design_routing(curve, tendons=1, routing="curved")
print(f"off by {design.error_rms:.3f} mm rms at {design.tensions.sum():.1f} N")
figure = draw_design(design)
