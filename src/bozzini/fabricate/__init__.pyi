from .effector import HolderOptions, build_holders, draw_template
from .files import write_body, write_holders
from .part import Channel, Part
from .robot import BodyOptions, Routing, build_body, tabulate_routing
from .step import write_step

__all__ = [
    "BodyOptions",
    "Channel",
    "HolderOptions",
    "Part",
    "Routing",
    "build_body",
    "build_holders",
    "draw_template",
    "tabulate_routing",
    "write_body",
    "write_holders",
    "write_step",
]
