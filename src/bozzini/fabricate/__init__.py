"""Files to make a robot from: discs, sleeves, holders and fittings as STL and STEP.

Surfaces are closed by construction and need no other library. STEP files are made by Open CASCADE
(the extra ``cad``), which is loaded where it is used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
