from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from bozzini.errors import FileFormatError, GeometryError, InputError
from bozzini.vision import (
    CameraSet,
    Light,
    Picture,
    RenderedTube,
    Scene,
    Sensor,
    render_picture,
    write_picture,
)
from bozzini.vision.pictures import read_manifest
from bozzini.vision.track import (
    TrackOptions,
    find_pixels,
    find_spots,
    read_pixels,
    track_markers,
    write_track,
)
from tests.vision.sets import PAIR

CAMERAS = CameraSet(names=("left", "right"), cameras=PAIR, world="the rig")
ALL_ROUND = Light(ambient=1.0, diffuse=0.0)


def _way(count: int = 30) -> np.ndarray:
    """Return two markers that move together, (count, 2, 3)."""
    t = np.linspace(0.0, 1.0, count)
    first = np.stack([30.0 * t - 15.0, 5.0 * t, 20.0 + 12.0 * t], axis=1)
    return np.stack([first, first + [-2.0, 9.0, 7.0]], axis=1)


def _write_table(path, pixels, *, columns="{c}{axis}{m}") -> None:
    names = [
        columns.format(c=camera, axis=axis, m=marker)
        for camera in ("L", "R")
        for marker in (1, 2)
        for axis in "xy"
    ]
    rows = np.moveaxis(pixels, 0, 1).reshape(pixels.shape[1], -1)
    lines = [",".join(["time_s", *names])]
    lines += [
        ",".join([f"{0.2 * k:g}", *("" if np.isnan(v) else f"{v:.4f}" for v in row)])
        for k, row in enumerate(rows)
    ]
    path.write_text("\n".join(lines) + "\n")


def _track(tmp_path, pixels, **options):
    _write_table(tmp_path / "t.csv", pixels)
    table = read_pixels(read_manifest(tmp_path / "t.csv", ()), CAMERAS)
    return track_markers(table, CAMERAS, options=TrackOptions(**options))


def _project(points):
    return np.stack([camera.project(points) for camera in PAIR])


def test_markers_are_placed_where_they_are(tmp_path):
    points = _way()
    found = _track(tmp_path, _project(points))
    assert found.points == pytest.approx(points, abs=1e-3)
    assert found.converged and set(found.status) == {"ok"}
    assert found.markers == ("1", "2")
    assert found.copied["time_s"][1] == "0.2"
    assert found.residual < 1e-3


@pytest.mark.parametrize("noise", [0.2, 1.0])
def test_errors_are_as_large_as_claimed(tmp_path, noise):
    rng, points = np.random.default_rng(0), _way(200)
    pixels = _project(points) + rng.normal(0.0, noise, (2, 200, 2, 2))
    found = _track(tmp_path, pixels, pixel_uncertainty=0.1)
    assert found.pixel_uncertainty == pytest.approx(noise, rel=0.15)
    off = found.points - points
    squares = np.einsum("nmi,nmij,nmj->nm", off, np.linalg.inv(found.covariance), off)
    assert np.sqrt(squares.mean() / 3.0) == pytest.approx(1.0, abs=0.2)
    for axis in range(3):
        ratio = off[..., axis] / found.uncertainty[..., axis]
        assert ratio.std() == pytest.approx(1.0, abs=0.2)


def test_markers_that_change_places_are_put_right_and_flagged(tmp_path):
    points = _way()
    pixels = _project(points)
    pixels[1, 7] = pixels[1, 7, ::-1]  # in one camera
    pixels[:, 12] = pixels[:, 12, ::-1]  # in both
    found = _track(tmp_path, pixels)
    assert found.points == pytest.approx(points, abs=1e-3)
    flagged = [k // 2 for k, flag in enumerate(found.flags) if flag]
    assert flagged == [7, 7, 12, 12]
    assert found.converged


def test_another_spot_and_an_empty_cell_cost_one_point_each(tmp_path):
    points = _way()
    pixels = _project(points)
    pixels[0, 5, 0] += [0.0, 60.0]  # something else is taken for marker 1
    pixels[1, 9, 1] = np.nan
    # Marker 2 stands under the name of 1, and something else under the name of 2.
    pixels[0, 20] = [pixels[0, 20, 1], pixels[0, 20, 0] + [0.0, 80.0]]
    found = _track(tmp_path, pixels)
    lost = np.isnan(found.points).any(axis=2)
    assert np.argwhere(lost).tolist() == [[5, 0], [9, 1], [20, 0]]
    assert found.points[~lost] == pytest.approx(points[~lost], abs=1e-3)
    assert [found.status[2 * row + marker] for row, marker in np.argwhere(lost)] == ["failed"] * 3
    assert "rays miss each other" in found.reasons[10]
    assert "not seen by two cameras" in found.reasons[19]
    assert found.reason.startswith("3 of 60 points failed (row 6, marker 1")


def test_pixels_counted_in_another_way_are_flagged(tmp_path):
    pixels = np.stack([camera.project(_way()) for camera in PAIR])
    pixels[1, ..., 1] += 8.0  # one camera's pictures are cropped
    found = _track(tmp_path, pixels)
    assert "ok" not in found.status
    assert not any(
        status == "flagged" and "rays_miss" not in words
        for status, words in zip(found.status, found.flags, strict=True)
    )


@pytest.mark.filterwarnings("error")
def test_points_behind_the_cameras_are_none(tmp_path):
    """Two cameras that look alike and whose columns are confused."""
    left = PAIR[0]
    shift = np.array([30.0, 0.0, 0.0])
    right = replace(left, translation=left.translation - shift)
    cameras = CameraSet(names=("left", "right"), cameras=(left, right))
    pixels = np.stack([camera.project(_way()) for camera in (right, left)])
    _write_table(tmp_path / "t.csv", pixels)
    found = track_markers(read_pixels(read_manifest(tmp_path / "t.csv", ()), cameras), cameras)
    assert set(found.status) == {"failed"}
    assert np.isnan(found.points).all()
    assert "do not meet in front of the cameras" in found.reason
    assert found.to_dict()["median_uncertainty_mm"] is None


def test_a_pixel_outside_the_picture_is_told(tmp_path):
    pixels = np.stack([camera.project(_way()) for camera in PAIR])
    pixels[0, 4, 1, 0] = 1e9
    found = _track(tmp_path, pixels)
    assert found.status.count("failed") == 1
    assert "is outside the" in found.reasons[9]


def test_what_the_lens_was_not_calibrated_for_is_flagged(tmp_path):
    pixels = _project(_way())
    areas = tuple((0.0, 0.0, 639.0, float(np.median(own[..., 1]))) for own in pixels)
    cameras = CameraSet(names=CAMERAS.names, cameras=PAIR, areas=areas)
    _write_table(tmp_path / "t.csv", pixels)
    found = track_markers(read_pixels(read_manifest(tmp_path / "t.csv", ()), cameras), cameras)
    inside = cameras.covers(pixels).ravel()
    assert 10 < inside.sum() < 50
    assert [flag == "" for flag in found.flags] == inside.tolist()


@pytest.mark.slow
def test_calibration_adds_its_uncertainty(tmp_path, pair_calibration):
    pixels = _project(_way())
    _write_table(tmp_path / "t.csv", pixels, columns="{c}_{axis}_{m}")
    calibrated = pair_calibration.cameras
    cameras = CameraSet(
        names=CAMERAS.names, cameras=calibrated.cameras, resamples=calibrated.resamples
    )
    sure = CameraSet(names=CAMERAS.names, cameras=calibrated.cameras)
    manifest = read_manifest(tmp_path / "t.csv", ())
    with_it, without = (track_markers(read_pixels(manifest, c), c) for c in (cameras, sure))
    added = with_it.covariance - without.covariance
    assert np.trace(added, axis1=-2, axis2=-1).min() > 0.0
    assert added == pytest.approx(cameras.calibration_covariance(pixels), abs=1e-12, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "0 markers in its columns"),
        ("Lx1,Ly1,Rx1\n1,2,3\n", "marker 1 has no column of y for camera right"),
        ("Lx1,Ly1,Rx1,Ry1\n1,2,3,x\n", "row 1, column 'Ry1' is 'x'"),
        ("Lx1,Ly1,Rx1,Ry1\n1,2,3,inf\n", "row 1, column 'Ry1' is 'inf'"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path, text, said):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(FileFormatError, match=said) as caught:
        read_pixels(read_manifest(tmp_path / "t.csv", ()), CAMERAS)
    assert "\n" not in str(caught.value)


def test_one_camera_gives_no_points(tmp_path):
    alone = CameraSet(names=("left",), cameras=PAIR[:1])
    (tmp_path / "t.csv").write_text("Lx1,Ly1\n1,2\n")
    table = read_pixels(read_manifest(tmp_path / "t.csv", ()), alone)
    with pytest.raises(InputError, match="need two"):
        track_markers(table, alone)


def _balls(points, albedo=0.8) -> tuple[RenderedTube, ...]:
    tiny = np.outer([-1e-4, 1e-4], [0.0, 0.0, 1.0])
    return tuple(RenderedTube(curve=point + tiny, radius=0.9, albedo=albedo) for point in points)


def _photograph(points, folder, row, *, seed=0) -> str:
    names = []
    for name, camera in zip(CAMERAS.names, PAIR, strict=True):
        scene = Scene(tubes=_balls(points), light=ALL_ROUND)
        picture = render_picture(scene, camera, sensor=Sensor(supersampling=1), seed=seed + row)
        names.append(write_picture(picture, folder / f"{name}{row}.png").name)
    return ",".join(names)


def test_markers_are_found_in_pictures(tmp_path):
    points = _way(3)
    rows = [f"{k},{_photograph(points[k], tmp_path, k)}" for k in range(3)]
    rows += ["3,left0.png,none.png", "4,turned.png,right0.png"]
    note = Image.Exif()
    note[274] = 6
    Image.open(tmp_path / "left0.png").save(tmp_path / "turned.png", exif=note)
    (tmp_path / "m.csv").write_text("\n".join(["pose,left,right", *rows]) + "\n")
    manifest = read_manifest(tmp_path / "m.csv", ())
    options = TrackOptions(diameter=12.0, pixel_uncertainty=0.1)
    found = track_markers(find_pixels(manifest, CAMERAS, options), CAMERAS, options=options)
    flipped = found.points[:3] if found.points[0, 0, 1] < 4.0 else found.points[:3, ::-1]
    off = np.linalg.norm(flipped - points, axis=2)
    assert off.max() < 0.1
    assert found.status[:6] == ("ok",) * 6
    assert found.status[6:] == ("failed",) * 2 + ("flagged",) * 2
    assert found.flags[8] == "exif_rotated"
    assert found.points[4] == pytest.approx(found.points[0])
    assert "no such picture" in found.reasons[6]

    out = tmp_path / "out"
    summary = write_track(found, out, manifest=manifest, cameras=CAMERAS)
    assert (
        json.loads((out / "summary.json").read_text(encoding="utf-8"))["files"] == summary["files"]
    )
    assert "overlays/0001_left.jpg" in summary["files"]
    import pandas

    table = pandas.read_csv(out / "points.csv")
    assert table["x_mm"].to_numpy()[:6] == pytest.approx(found.points[:3, :, 0].ravel())
    assert table["u_z_mm"].to_numpy()[:6] == pytest.approx(found.uncertainty[:3, :, 2].ravel())
    assert table["x_mm"].isna().sum() == 2
    assert table["pose"].tolist() == [k for k in range(5) for _ in range(2)]


def test_too_few_and_too_many_spots_are_told():
    rng = np.random.default_rng(0)
    picture = np.full((100, 160), 0.3, np.float32) + rng.normal(0, 0.01, (100, 160))
    y, x = np.mgrid[:100, :160]
    middles = np.array([[40.3, 50.6], [100.7, 40.2]])
    for mx, my in middles:
        picture += 0.5 * (np.hypot(x - mx, y - my) < 6.0)
    bright = Picture(picture.astype(np.float32))
    options = TrackOptions(diameter=12.0)
    found, note = find_spots(bright, options)
    assert found == pytest.approx(middles, abs=0.15)
    assert note == ""
    assert find_spots(bright, TrackOptions(diameter=12.0, markers=1))[1] == "ambiguous_markers"
    with pytest.raises(GeometryError, match="2 bright spots of 12 px found, 3 are needed"):
        find_spots(bright, TrackOptions(diameter=12.0, markers=3))
    dark = Picture((1.0 - picture).astype(np.float32))
    assert find_spots(dark, TrackOptions(shade="dark"))[0] == pytest.approx(found, abs=1e-3)


def test_the_picture_shows_the_ways(tmp_path):
    found = _track(tmp_path, _project(_way()))
    ax = found.plot()
    assert ax.get_xlabel() == "x [mm]" and ax.get_ylabel() == "z [mm]"
    assert len(ax.containers) == 2
