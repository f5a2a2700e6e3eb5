"""A board in Python: three PI controllers with the dead zone of the valves compensated."""

from __future__ import annotations

import numpy as np

from bozzini.rig.plant import PlantDesign


class PiBoard:
    """Controls the pressures to the set-points that `write` brings, three float64 [MPa]."""

    def __init__(self, design=None, gain=6.0, reset_time=0.4):
        self.design = design or PlantDesign()
        self.gain, self.reset_time = gain, reset_time
        self.reset()

    def reset(self):
        self.set_points = np.zeros(3)
        self.integral = np.zeros(3)
        self.measured = np.zeros(3)
        self.sent = b""

    def set_voltages(self, voltages):
        self.measured = self.design.to_pressure(np.asarray(voltages)[:3])

    def write(self, data):
        self.set_points = np.frombuffer(data)

    def read(self):
        sent, self.sent = self.sent, b""
        return sent

    def run(self, duration):
        error = self.set_points - self.measured
        near = np.abs(error) < 0.02
        self.integral = np.where(near, self.integral + error * duration / self.reset_time, 0.0)
        effort = np.clip(self.gain * (error + self.integral), -1.0, 1.0)
        jump = self.design.valve_dead_zone + 0.5 * self.design.valve_hysteresis
        duty = np.where(np.abs(error) < 0.003, 0.0, jump + (1.0 - jump) * np.abs(effort))
        self.sent = self.measured.tobytes()
        fill, bleed = np.where(effort > 0, duty, 0.0), np.where(effort < 0, duty, 0.0)
        return np.concatenate([fill, bleed, [1.0]])
