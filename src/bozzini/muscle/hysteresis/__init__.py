"""Hysteresis: operators with memory, which a muscle model carries or which are fitted to loops.

`Hysteresis` is what a model asks for; the operators are those of the thesis's section 2.2.10.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
