from .anchor import HeadReach, ReachedFrom, ReachOptions, Stand, find_reached, stand_head
from .check import HeadCheck, HeadLayout, HeadView, check_head, lay_out, view_head
from .design import (
    FITS,
    EndCap,
    Head,
    HeadCamera,
    Instrument,
    PlacedEffector,
    SectionPoses,
    read_head,
    write_head,
)
from .shape import HeadPose, pose_head

__all__ = [
    "FITS",
    "EndCap",
    "Head",
    "HeadCamera",
    "HeadCheck",
    "HeadLayout",
    "HeadPose",
    "HeadReach",
    "HeadView",
    "Instrument",
    "PlacedEffector",
    "ReachOptions",
    "ReachedFrom",
    "SectionPoses",
    "Stand",
    "check_head",
    "find_reached",
    "lay_out",
    "pose_head",
    "read_head",
    "stand_head",
    "view_head",
    "write_head",
]
