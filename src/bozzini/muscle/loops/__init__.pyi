from .loop_fit import LoopFit, LoopFitOptions, fit_loop
from .model import OPERATORS, Compensation, LoopModel, load_loop_model, save_loop_model
from .record import LoopRecord, LoopSamples, read_loop

__all__ = [
    "OPERATORS",
    "Compensation",
    "LoopFit",
    "LoopFitOptions",
    "LoopModel",
    "LoopRecord",
    "LoopSamples",
    "fit_loop",
    "load_loop_model",
    "read_loop",
    "save_loop_model",
]
