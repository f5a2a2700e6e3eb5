"""Motion: how a scope moves through a duct (thesis 5.3), and what is proved about it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
