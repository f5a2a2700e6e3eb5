from .board import NativeBoard
from .camera_bench import BenchReport, CameraBench, RenderedCamera, VideoCamera
from .characterise import (
    Characterisation,
    PictureHook,
    PictureSource,
    PlantGauge,
    characterise_muscle,
)
from .choices import CONTROLLERS
from .cosimulation import ControlBoard, Cosimulation, CosimulationRecord
from .curves import PressureCurve, read_curve, take_curve
from .demo import CircleRun, FaultResponses, StepResponses, run_circle, run_faults, run_steps
from .emulate import emulate_rig, emulated_port, serve
from .emulator import EmulatedBoard, EmulationError
from .feedforward import Feedforward
from .firmware import ToolchainError
from .host import Host, HostRun, Replay, load_log, replay_log
from .hysteresis import HysteresisCompensator, HystereticPlant, MotionObserver
from .identify import CurveFit, Identification, identify_fill, identify_leak
from .link import Link, LockstepLink, SerialLink
from .plant import FAULT_KINDS, Chamber, Fault, Plant, PlantDesign
from .pneumatics import ATMOSPHERE, Orifice
from .predictive import PredictiveSteering
from .selftest import SelfTest, check_board
from .stairs import Stairs
from .steering import Steering, make_controller, open_rig_effector
from .stick import BoardStick, GamepadStick, ScriptedStick, StickSource, make_stick

__all__ = [
    "ATMOSPHERE",
    "CONTROLLERS",
    "FAULT_KINDS",
    "ControlBoard",
    "BenchReport",
    "BoardStick",
    "CameraBench",
    "Chamber",
    "Characterisation",
    "CircleRun",
    "Cosimulation",
    "CosimulationRecord",
    "CurveFit",
    "EmulatedBoard",
    "EmulationError",
    "Fault",
    "FaultResponses",
    "Feedforward",
    "GamepadStick",
    "Host",
    "HostRun",
    "HysteresisCompensator",
    "HystereticPlant",
    "Identification",
    "Link",
    "LockstepLink",
    "MotionObserver",
    "NativeBoard",
    "Orifice",
    "PictureHook",
    "PictureSource",
    "Plant",
    "PlantDesign",
    "PlantGauge",
    "PredictiveSteering",
    "PressureCurve",
    "Replay",
    "RenderedCamera",
    "ScriptedStick",
    "SelfTest",
    "SerialLink",
    "Stairs",
    "Steering",
    "StepResponses",
    "StickSource",
    "ToolchainError",
    "VideoCamera",
    "characterise_muscle",
    "check_board",
    "emulate_rig",
    "emulated_port",
    "identify_fill",
    "identify_leak",
    "load_log",
    "make_controller",
    "make_stick",
    "open_rig_effector",
    "read_curve",
    "replay_log",
    "run_circle",
    "run_faults",
    "run_steps",
    "serve",
    "take_curve",
]
