from .design import RoutingDesign, design_routing
from .options import InsertionRankOptions, RobotSearch
from .rank import InsertionRank, insertion_rank
from .tract import TractRobot, design_robot

__all__ = [
    "InsertionRank",
    "InsertionRankOptions",
    "RobotSearch",
    "RoutingDesign",
    "TractRobot",
    "design_robot",
    "design_routing",
    "insertion_rank",
]
