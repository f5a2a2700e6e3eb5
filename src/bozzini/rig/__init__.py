"""The rig: compressor, valves, muscles and transducers as a plant, and the board that drives it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
