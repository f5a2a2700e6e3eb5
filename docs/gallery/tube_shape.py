"""The shape of a tube from two pictures.

A bent catheter is rendered from two sides; its centreline is found by stereo and laid beside the
model's, from which the pictures were made.
"""

import matplotlib.pyplot as plt
import numpy as np

from bozzini.effector import Effector, effector_preset
from bozzini.vision import (
    CameraSet,
    PairLayout,
    ShapeOptions,
    compare_shapes,
    make_backbone_scene,
    measure_shape,
    render_picture,
)

model = Effector(effector_preset("prototype")).forward({"R": 0.6}).backbone  # [MPa]
layout = PairLayout(size=(640, 400), pitch=0.15)
cameras = CameraSet(names=("left", "right"), cameras=layout.make_cameras())
scene = make_backbone_scene(model)
pictures = [render_picture(scene, camera, seed=k) for k, camera in enumerate(cameras.cameras)]

shape = measure_shape(pictures, cameras, options=ShapeOptions(length=45.0))
found = compare_shapes([shape], [model], alignment="world")
print(f"off by {found.residual:.3f} mm rms, {np.max(found.distances):.3f} mm at most")
figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.0), layout="constrained")
found.plot(left)
found.plot_distances(right)
