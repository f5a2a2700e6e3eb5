"""The shape of a tube from two pictures.

A bent catheter is rendered from two sides; its centreline is found by stereo and compared with the
model's.
"""

from bozzini.effector import Effector, effector_preset
from bozzini.vision import (
    CameraSet,
    PairLayout,
    ShapeOptions,
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
print("standard uncertainty of the tip", shape.converged, shape.reason)
axes = shape.plot()
