# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---

# %% [markdown]
# # 4 A catheter tip with three muscles under a stick
#
# A stick's place becomes a place of the tip, that becomes three pressures, and a board with its own
# firmware fills and vents the muscles. All of it is emulated; a board at a serial port takes the
# emulation's place in one line. This needs the compiler `gcc`; `bozzini doctor` tells.

# %%
import matplotlib.pyplot as plt
import numpy as np

from bozzini.effector import Effector, effector_preset, workspace
from bozzini.plot.effector import draw_pose
from bozzini.rig import Host, LockstepLink, ScriptedStick, Steering, emulate_rig

# %% [markdown]
# ## The tip
#
# Three muscles round a backbone. `effector_preset` takes changes of any dimension.

# %%
tip = Effector(effector_preset("prototype"))
pose = tip.forward({"R": 0.5, "G": 0.2})  # [MPa]
draw_pose(tip, pose, workspace=workspace(tip))

# %% [markdown]
# The inverse is exact: of all pressures that bring the tip there, the least.

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
host.connect()

# %% [markdown]
# The stick goes round twice a second for two seconds. `GamepadStick()` reads yours.

# %%
stick = ScriptedStick.circle(frequency=0.5, duration=4.0)
run = host.run(Steering(tip, stick), 4.0)
print(f"error of the tip {run.tip_error_rms:.2f} mm rms, {run.tip_error_max:.2f} mm at most")
run.plot()

# %% [markdown]
# ## The log
#
# A row for each period: set-points, pressures, duties, stick, state and faults.

# %%
log = run.to_frame()
print(list(log.columns))

# %%
figure, axes = plt.subplots(layout="constrained")
axes.plot(1000.0 * run.periods, ".")
axes.set(xlabel="period", ylabel="length of a period [ms]")

# %% [markdown]
# On the bench, `SerialLink("/dev/ttyACM0")` in place of `LockstepLink(rig)`. Before that, read the
# [safety file](../rig/safety.md), and let `bozzini rig selftest --port PORT` check it.
