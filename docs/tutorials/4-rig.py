# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 4 A catheter tip with three muscles under a stick
#
# A stick's place becomes a place of the tip, that becomes three pressures, and a board with its own
# firmware fills and vents the muscles. All of it is emulated; a board at a serial port takes the
# emulation's place in one line. This needs `make` and `gcc`; `bozzini doctor` tells.

# %%
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from bozzini.effector import Effector, effector_preset, workspace
from bozzini.plot.effector import draw_pose
from bozzini.rig import Host, LockstepLink, ScriptedStick, Steering, emulate_rig

# %% [markdown]
# ## The tip
#
# Three muscles round a backbone. `effector_preset` takes changes of the tip, such as `offset=3.5`;
# length and muscles are changed as here. `bozzini muscle fit` finds the numbers of yours.

# %%
design = effector_preset("prototype").resize(45.0)  # backbone and muscles [mm]
muscles = [replace(each, muscle=each.muscle.replace(modulus=0.56)) for each in design.muscles]
tip = Effector(design.replace(muscles=muscles))
pose = tip.forward({"R": 0.5, "G": 0.2})  # [MPa]
draw_pose(tip, pose, workspace=workspace(tip))

# %% [markdown]
# Shaded is where the tip can go. The inverse is exact: of all pressures that bring it there, the
# least. Out of reach `converged` is False, and `found.reason` tells which muscle is at its most.

# %%
found = tip.inverse(tip=(3.0, -4.0))  # [mm]
print(found.pressures, "MPa, converged:", found.converged)
assert np.allclose(tip.forward(found.pressures).tip[:2], (3.0, -4.0), atol=1e-6)

# %% [markdown]
# ## The rig
#
# Reservoir, valves, lines and muscles, and the board's program compiled for this computer. The host
# sends set-points every 10 ms; the board controls the pressures every millisecond.

# %%
rig = emulate_rig(tip.models, board="native", seed=1)
host = Host(LockstepLink(rig), period=0.01)
board = host.connect()

# %% [markdown]
# The stick goes round once in two seconds, twice. `GamepadStick()` reads yours (extra `rig`).

# %%
stick = ScriptedStick.circle(frequency=0.5, duration=4.0)
run = host.run(Steering(tip, stick), 4.0)
print(f"error of the tip {run.tip_error_rms:.2f} mm rms, {run.tip_error_max:.2f} mm at most")
run.plot()

# %% [markdown]
# Dashed is what is asked for. The tip is late by what filling a muscle through a valve takes:
# that is the error. [Control](../rig/control.md) has less of it, by a model of valves and lines.
#
# ## The log
#
# A row for each period: set-points, pressures, duties, stick, state and faults.

# %%
log = run.to_frame()
print(list(log.columns))

# %%
figure, axes = plt.subplots(layout="constrained")
axes.plot(log["target_x_mm"], log["target_y_mm"], "k--", label="asked for by the stick")
axes.plot(log["tip_x_mm"], log["tip_y_mm"], label="tip")
axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
_ = axes.legend()

# %% [markdown]
# At full stick the circle leaves the workspace: there the target goes along its edge.
#
# On the bench, `SerialLink("/dev/ttyACM0")` in place of `LockstepLink(rig)`. Before that, read the
# [safety file](../rig/safety.md), and let `bozzini rig selftest --port PORT` check it.
