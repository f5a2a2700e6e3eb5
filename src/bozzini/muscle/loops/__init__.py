"""Recorded loops: from time, pressure and contraction or force to an operator that is carried."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
