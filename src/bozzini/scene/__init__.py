"""What can be turned: a plan as an animated scene (GLB), and pages that show anything in 3-D."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
