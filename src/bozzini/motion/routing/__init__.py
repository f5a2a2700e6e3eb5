"""Robots designed for a tract: routings that hold one shape, what the way in takes, sections."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
