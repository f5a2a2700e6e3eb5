"""The distal head: a camera on its arm, end-effectors with instruments, a cap over all (ch. 4)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
