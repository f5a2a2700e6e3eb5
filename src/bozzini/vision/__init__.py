"""Measurement by pictures: boards, cameras, calibration, markers, and rendered pictures.

OpenCV (the extra ``vision``) is loaded where it is used, not by this package's import.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
