"""Tracts: read from CT labels or surfaces, made as a phantom, or fetched from public sources.

Everything is in mm, in the frame of the file (RAS+ for NIfTI: +x to the patient's right, +y to the
front, +z to the head; LPS for DICOM and MetaImage).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
