"""Gas in a CT that the test makes: a body with lungs, a table, and a bent tube that is known."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from bozzini.anatomy import segment_gas
from bozzini.anatomy.labels import Volume
from bozzini.errors import InputError

STEP = 2.0
RADIUS = 12.0
LEVEL = -8.0


@functools.cache
def make_scan(*, fluid=None, noise=25.0, order="F", lungs="cut"):
    """Return a CT [HU] and the distance of each voxel from the line of its tube [mm].

    Every voxel of the tube's wall and of the fluid's level holds its part of both (partial
    volume). The fluid fills the tube below y = `LEVEL`.
    """
    random = np.random.default_rng(0)
    shape = np.array([120, 90, 100])
    axes = [(np.arange(n) - 0.5 * n * (k < 2)) * STEP for k, n in enumerate(shape)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    ct = np.full(shape, -1000.0)
    ct[(x / 100) ** 2 + (y / 65) ** 2 < 1] = 40.0
    table = (np.abs(x) < 80) & (np.abs(y + 75) < 6)
    ct[table] = 100.0
    ct[table & (np.abs(x) < 76) & (np.abs(y + 75) < 4)] = -950.0  # hollow
    middle, half, density = (180, 60, -860.0) if lungs == "cut" else (135, 45, -945.0)
    air = ((np.abs(x) - 45) / 30) ** 2 + (y / 45) ** 2 + ((z - middle) / half) ** 2 < 1
    ct[air] = density + random.normal(0.0, 60.0, np.count_nonzero(air))
    if lungs == "dark with a trachea":
        ct[(np.hypot(x, y) < 8) & (z > 145)] = -1000.0
        ct[(np.hypot(z - 145, y) < 7) & (np.abs(x) < 20)] = -1000.0
    bend = np.linspace(0.0, np.pi, 400)
    line = np.stack([60 * np.cos(bend), 20 - 45 * np.sin(bend), np.full_like(bend, 60.0)], axis=1)
    places = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    distance = cKDTree(line).query(places, distance_upper_bound=30.0)[0].reshape(shape)
    part = np.clip((RADIUS - distance) / STEP + 0.5, 0.0, 1.0)
    inside = np.full(shape, -1000.0)
    if fluid is not None:
        wet = np.clip((LEVEL - y) / STEP + 0.5, 0.0, 1.0)
        inside += wet * (fluid + 1000.0)
    ct = ct * (1 - part) + inside * part + random.normal(0.0, noise, shape)
    affine = np.diag([STEP, STEP, STEP, 1.0])
    affine[:3, 3] = [axis[0] for axis in axes]
    array = np.asarray(np.rint(ct).astype(np.int16), order=order)
    return Volume(array=array, affine=affine, source="ct", frame="RAS"), distance, part


@pytest.mark.parametrize("order", ["C", "F"])
def test_the_known_tube_is_found_alone_and_never_too_wide(order):
    scan, distance, part = make_scan(order=order)
    found = segment_gas(scan)
    assert len(found.segments) == 1  # no air outside, no table, no lung
    mask = found.labels == 1
    assert distance[mask].max() <= RADIUS
    # The wall lies inside the true one, by less than a voxel.
    assert mask[distance < RADIUS - STEP].all()
    segment = found.segments[0]
    assert segment.volume == pytest.approx(np.count_nonzero(mask) * STEP**3)
    assert 0.8 < segment.volume / (part.sum() * STEP**3) < 1.0
    assert not segment.at_border and segment.fluid == 0.0
    index = np.rint((np.array(segment.point) - scan.affine[:3, 3]) / STEP).astype(int)
    assert mask[tuple(index)]
    lungs = 2 * 4 / 3 * np.pi * 30 * 45 * 60 * 0.65  # about; they are cut by the image's border
    assert found.lungs == pytest.approx(lungs, rel=0.15)


def test_a_lower_threshold_gives_a_narrower_lumen():
    scan, distance, _ = make_scan(noise=5.0)
    volumes = [segment_gas(scan, threshold=t).segments[0].volume for t in (-900, -800, -600, -480)]
    assert volumes == sorted(volumes) and len(set(volumes)) == 4
    middle = 2 * STEP**3 * np.count_nonzero(distance < RADIUS)
    assert 2 * volumes[-1] == pytest.approx(middle, rel=0.03)  # at the half value: the true wall


def test_fluid_cuts_the_tube_in_two_and_is_bridged_on_request():
    scan, distance, part = make_scan(fluid=400.0)
    dry = segment_gas(scan)
    assert len(dry.segments) == 2
    assert dry.segments[0].volume == pytest.approx(dry.segments[1].volume, rel=0.02)
    wet = segment_gas(scan, bridge_fluid=True)
    assert len(wet.segments) == 1
    mask = wet.labels == 1
    assert distance[mask].max() <= RADIUS + 0.5 * STEP
    assert mask[distance < RADIUS - STEP].mean() > 0.995  # the layer of partial volume too
    segment = wet.segments[0]
    assert 0.8 < segment.volume / (part.sum() * STEP**3) < 1.02
    assert 0.0 < segment.fluid < segment.volume
    assert "2 levels" in {item.code: item.message for item in wet.findings}["fluid-bridged"]


@pytest.mark.parametrize("axes", [(0, 2, 1), (1, 0, 2), (2, 1, 0)])
def test_down_is_found_in_any_orientation(axes):
    scan, _, _ = make_scan(fluid=500.0)
    plain = segment_gas(scan, bridge_fluid=True)
    flip = np.transpose(scan.array, axes)[::-1]
    affine = scan.affine.copy()
    affine[:, :3] = affine[:, list(axes)]
    affine[:3, 3] += affine[:3, 0] * (flip.shape[0] - 1)
    affine[:3, 0] *= -1
    turned = segment_gas(
        Volume(array=flip, affine=affine, source="ct", frame="RAS"), bridge_fluid=True
    )
    assert [s.volume for s in turned.segments] == pytest.approx([s.volume for s in plain.segments])
    np.testing.assert_allclose(turned.segments[0].point, plain.segments[0].point, atol=2 * STEP)


def test_fluid_without_contrast_is_not_guessed():
    scan, distance, _ = make_scan(fluid=15.0)
    found = segment_gas(scan, bridge_fluid=True)
    assert len(found.segments) == 2
    assert "fluid-none" in {item.code for item in found.findings}
    assert distance[found.labels > 0].max() <= RADIUS


def test_seeds_choose_and_must_lie_at_gas():
    scan, _, _ = make_scan(fluid=400.0)
    found = segment_gas(scan, seeds=[(60.0, 15.0, 60.0)])
    assert len(found.segments) == 1 and found.segments[0].point[0] > 0
    assert "gas-left-out" in {item.code for item in found.findings}
    for seed in ((0.0, 0.0, 10.0), (45.0, 0.0, 180.0)):  # the second in a lung
        with pytest.raises(InputError, match=r"from the nearest gas .* within 5 mm"):
            segment_gas(scan, seeds=[seed])


@pytest.mark.parametrize("height", [134.0, 140.0, 160.0])
@pytest.mark.parametrize("flip", [False, True])
def test_bases_of_lungs_are_no_gut(height, flip):
    scan, distance, _ = make_scan()
    top = int(height / STEP)
    array, affine = scan.array[:, :, :top], scan.affine.copy()
    if flip:
        array = array[:, :, ::-1]
        affine[:, 3] += (top - 1) * affine[:, 2]
        affine[:, 2] *= -1
    found = segment_gas(replace(scan, array=array, affine=affine))
    assert len(found.segments) == 1
    assert distance[:, :, :top][:, :, :: -1 if flip else 1][found.labels > 0].max() <= RADIUS
    deep = height - STEP - 120.0  # of the caps of both ellipsoids
    caps = 2 * np.pi * 30 * 45 * (deep / 60) ** 2 * (60 - deep / 3)
    assert found.lungs == pytest.approx(caps, rel=0.25)
    assert ("lung-cut" in {item.code for item in found.findings}) == (caps < 200e3)


def test_gut_that_is_cut_stays_gut():
    scan, _, _ = make_scan()
    found = segment_gas(replace(scan, array=scan.array[:, :, : int(64 / STEP)]))
    assert [item.at_border for item in found.segments] == [True]
    assert found.lungs == 0.0


def test_lungs_as_dark_as_gas_are_known_by_their_trachea():
    scan, distance, _ = make_scan(lungs="dark with a trachea")
    found = segment_gas(scan)
    assert len(found.segments) == 1 and distance[found.labels == 1].max() <= RADIUS
    assert found.lungs > 2 * 0.9 * 4 / 3 * np.pi * 30 * 45 * 45
    # The same air without a trachea is not known as lung, nor is it where up is not known.
    for other in (make_scan(lungs="dark")[0], replace(scan, frame=None)):
        assert segment_gas(other).lungs == 0.0
