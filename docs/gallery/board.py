"""A board that the camera sees.

A rendered picture of a calibration board, with blur and noise, and the corners found in it.
"""

import matplotlib.pyplot as plt

from bozzini.vision import CharucoBoard, Scene, Sensor, aim_camera, render_picture

board = CharucoBoard()
camera = aim_camera((90.0, 60.0, -260.0), (33.0, 24.0, 0.0), focal=1500.0, size=(640, 480))
picture = render_picture(Scene(board=board), camera, sensor=Sensor(noise=0.02), seed=1)
found = board.detect(picture)

figure, axes = plt.subplots(layout="constrained")
axes.imshow(picture.values, cmap="gray")
axes.plot(*found.corners.T, "+", color="tab:red")
axes.set(title=f"{len(found.corners)} corners", xticks=[], yticks=[])
