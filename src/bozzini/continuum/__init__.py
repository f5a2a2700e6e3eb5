"""Continuum robots: from tendon displacements to the shape and back (thesis 5.2)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
