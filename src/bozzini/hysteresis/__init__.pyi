from .comparison import LoopComparison, LoopParts, LoopRow, compare_laws
from .constants import Constant
from .files import LoopFile, LoopPrediction, predict_loops, read_law, write_law
from .fitting import Fitted
from .law import LoopLaw, LoopState
from .record import LoopRuns, LoopTitles, read_loops
from .tasks import LoopFitting, LoopPredicting, LoopTable

__all__ = [
    "Constant",
    "Fitted",
    "LoopComparison",
    "LoopFile",
    "LoopFitting",
    "LoopLaw",
    "LoopParts",
    "LoopPredicting",
    "LoopPrediction",
    "LoopRow",
    "LoopRuns",
    "LoopState",
    "LoopTable",
    "LoopTitles",
    "compare_laws",
    "predict_loops",
    "read_law",
    "read_loops",
    "write_law",
]
