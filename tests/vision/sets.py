"""What the tests of vision share: small cameras, and pictures of a board in many poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bozzini.vision import (
    Board,
    Camera,
    CharucoBoard,
    PairLayout,
    Picture,
    Scene,
    Sensor,
    make_board_poses,
    render_picture,
)

BOARD = CharucoBoard()
PAIR = PairLayout(size=(640, 400), pitch=0.15).make_cameras()
TARGET = (0.0, 0.0, 25.0)


def render_views(
    board: Board = BOARD,
    cameras: Sequence[Camera] = PAIR,
    *,
    count: int = 12,
    sensor: Sensor = Sensor(),
    seed: int = 0,
) -> tuple[list[list[Picture]], list[tuple[np.ndarray, np.ndarray]]]:
    """Return the pictures of each view and camera, and the poses of the board."""
    poses = make_board_poses(board, cameras, target=TARGET, count=count, seed=seed)
    pictures = [
        [
            replace(
                render_picture(
                    Scene(board=board),
                    camera.move_world(*pose),
                    sensor=sensor,
                    seed=1000 * seed + 2 * k + i,
                ),
                name=f"cam{i}_{k:02d}",
            )
            for i, camera in enumerate(cameras)
        ]
        for k, pose in enumerate(poses)
    ]
    return pictures, poses
