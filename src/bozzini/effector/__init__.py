"""The end-effector: muscles round a backbone, a pressure each, and where the tip goes (ch. 4)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
