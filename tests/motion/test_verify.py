"""The second checker against the certificate, and plans that are not what they say."""

from __future__ import annotations

import zipfile
from dataclasses import replace

import numpy as np
import pytest

from bozzini.duct import SampledField
from bozzini.errors import BozziniError, FileFormatError, InputError
from bozzini.motion import Plan, certify_plan
from bozzini.motion.recheck import EntryTube, recheck_motion, surface_wall, voxel_wall
from bozzini.motion.verify import check_consistency, verify_plan
from tests.exact import MeshWall, VoxelWall
from tests.motion.damage import (
    KINDS,
    VARIANTS,
    Planted,
    damage,
    find_wrong,
    recheck,
    sample_clearance,
)
from tests.motion.plans import rewrite


@pytest.fixture(scope="module")
def case():
    return Planted(4)


@pytest.fixture(scope="module")
def plan(case):
    made = case.plan(head_step=1.0)
    assert made.status == "complete" and made.certified
    return made


@pytest.fixture(scope="module")
def there_and_back(case):
    return case.plan(head_step=1.0, route=(1.0, 0.3, 0.8))


def check_agreement(case, plan, random, count):
    """Compare certificate, second checker and random samples; return the samples used."""
    certificate = certify_plan(plan, case.field)
    second = recheck(plan, case.wall, tolerance=0.1)
    samples = sample_clearance(plan, case.wall, count, random)
    least = min(samples.min(initial=np.inf), second.found)
    if least > -0.5 * case.field.reach:
        assert certificate.clearance <= least + 1e-9
    else:  # so far outside the field only knows that it is outside
        assert certificate.clearance < 0.0
    assert second.lower <= least + 1e-9
    assert second.resolved and second.found - second.lower <= 0.1 + 1e-9
    if certificate.certified:
        # Each bound is within its tolerance and the looseness of the field.
        assert abs(certificate.found - second.found) <= 0.3
        assert second.bore <= second.offered
    return len(samples) + second.samples


@pytest.mark.slow
@pytest.mark.parametrize("options", VARIANTS, ids=str)
def test_certificate_and_second_checker_agree(case, options):
    random = np.random.default_rng(1)
    made = case.plan(**options)
    assert check_agreement(case, made, random, 6_000) > 10_000


@pytest.mark.slow
@pytest.mark.parametrize("first", range(100, 118, 3))
def test_certificate_and_second_checker_agree_on_many_plans(first):
    random = np.random.default_rng(first)
    total = sum(
        check_agreement(case, case.plan(**options), random, 20_000)
        for case in map(Planted, range(first, first + 3))
        for options in VARIANTS
    )
    assert total > 500_000


def judge(damaged, case, folder):
    """Return whether a plan, written and read again, is accepted."""
    try:
        back = Plan.load(damaged.save(folder / "plan.npz"))
        field = case.field.inflate(back.field.inflation)
        return verify_plan(back, field).certified
    except (BozziniError, ValueError) as error:  # JSON takes no NaN
        assert "\n" not in str(error)
        return False


def check_damage(case, plans, random, count, folder):
    """Damage plans, and return by kind how many were accepted, all of which must be sound."""
    accepted = dict.fromkeys(KINDS, 0)
    for _ in range(count):
        plan = plans[int(random.integers(len(plans)))]
        try:
            kind, damaged = damage(plan, random)
        except InputError:
            continue
        if judge(damaged, case, folder):
            accepted[kind] += 1
            assert find_wrong(damaged, case.wall) == "", kind
    return accepted


@pytest.mark.slow
def test_damaged_plans_are_not_accepted(case, plan, there_and_back, tmp_path):
    assert judge(plan, case, tmp_path) and find_wrong(plan, case.wall) == ""
    accepted = check_damage(case, [plan, there_and_back], np.random.default_rng(3), 120, tmp_path)
    for kind in ("introducer in the tract", "not finite", "plane"):
        assert accepted[kind] == 0
    # What does no harm is let through, what does is not.
    assert 5 < sum(accepted.values()) < 75


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 102, 103, 105])
def test_many_damaged_plans_are_not_accepted(seed, tmp_path):
    case = Planted(seed)
    plans = [
        case.plan(head_step=1.0),
        case.plan(head_step=1.0, route=(1.0, 0.3, 0.8)),
        case.plan(head_step=1.0, method="thesis"),
    ]
    check_damage(case, plans, np.random.default_rng(seed), 200, tmp_path)


def check_broken(content, original, random, count, path):
    for _ in range(count):
        broken = bytearray(content)
        if random.random() < 0.2:
            broken = broken[: int(random.integers(len(broken)))]
        else:
            for _ in range(int(random.integers(1, 4))):
                broken[int(random.integers(len(broken)))] ^= 1 << int(random.integers(8))
        path.write_bytes(broken)
        try:
            back = Plan.load(path)
        except FileFormatError as error:
            assert "\n" not in str(error) and len(str(error)) < 400
            continue
        # A flipped bit in a date or a name that is not read.
        assert np.array_equal(back.joints, original.joints)
        assert back.meta == original.meta and back.status == original.status


def test_broken_files_are_refused_in_one_line(plan, tmp_path):
    path = plan.save(tmp_path / "plan.npz")
    check_broken(path.read_bytes(), Plan.load(path), np.random.default_rng(5), 150, path)


@pytest.mark.slow
def test_many_broken_files_are_refused_in_one_line(plan, tmp_path):
    path = plan.save(tmp_path / "plan.npz")
    check_broken(path.read_bytes(), Plan.load(path), np.random.default_rng(6), 1500, path)


def test_each_fault_is_named(case, plan):
    def faults(**changes):
        changed = replace(plan, **changes)
        return {item.name for item in check_consistency(changed) if not item.ok}

    assert faults() == set()
    joints = plan.joints.copy()
    joints[40:, 3] += [0.0, 0.01, 0.0]
    assert "links" in faults(joints=joints)
    assert faults(joints=plan.joints + 0.1) == {"head", "closest place"}
    assert "steps" in faults(head_arc_length=plan.head_arc_length[::-1])
    jump = plan.joints.copy()
    jump[60:, :] += [0.0, 0.0, 5.0]
    assert "moves" in faults(joints=jump)
    inwards = replace(plan.introducer, outward=-plan.introducer.outward)
    assert "introducer" in faults(introducer=inwards)
    assert faults(measures=replace(plan.measures, clearance_min=3.0)) == {"measures"}


@pytest.mark.slow
def test_a_claim_is_held_to_the_proof_not_to_its_looseness(case, plan):
    second = recheck(plan, case.wall, tolerance=0.01)
    for claim, holds in ((0.0, True), (second.lower - 0.35, True), (second.found + 0.01, False)):
        proof = replace(plan.certificate, clearance=max(claim, 0.0))
        result = verify_plan(replace(plan, certificate=proof), case.field)
        assert result.certified == holds


def test_clearances_at_steps_are_measured_anew(case, plan):
    clearance = np.where(np.isfinite(plan.clearance), plan.clearance + 2.0, np.inf)
    measures = replace(plan.measures, clearance_min=float(clearance.min()))
    forged = replace(plan, clearance=clearance, measures=measures)
    result = verify_plan(forged, case.field)
    assert [item.name for item in result.checks if not item.ok] == ["clearances"]
    assert not result.certified


def test_a_wall_inflated_otherwise_is_another_wall(case, plan):
    result = verify_plan(plan, case.field.inflate(1.0))
    assert not result.certified
    assert "wall" in {item.name for item in result.checks if not item.ok}


def test_distances_outside_may_be_cut_off_beyond_the_inflation(case, plan):
    # As a field that is only sampled in a band around its wall has them.
    joints = plan.joints.copy()
    joints[50:, 2] += 30.0
    for moved in (plan, replace(plan, joints=joints)):
        for inflation in (0.0, 1.5):
            whole = case.field.inflate(inflation)
            cut = np.minimum(whole.values, np.float32(inflation + 1.0))
            band = replace(whole, values=cut)
            assert isinstance(band, SampledField)
            first, other = certify_plan(moved, whole), certify_plan(moved, band)
            assert first.certified == other.certified
            if first.certified:
                assert first.clearance == pytest.approx(other.clearance, abs=1e-4)


def box(low, high):
    import trimesh

    mesh = trimesh.creation.box(bounds=[low, high])
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def test_the_second_checker_measures_boxes_exactly():
    random = np.random.default_rng(8)
    vertices, faces = box([0.0, 0.0, 0.0], [30.0, 20.0, 10.0])
    mask = np.zeros((34, 24, 14), dtype=bool)
    mask[2:32, 2:22, 2:12] = True
    affine = np.eye(4)
    affine[:3, 3] = -1.5  # the middle of the first voxel inside is (0.5, 0.5, 0.5)
    points = random.uniform(-5.0, [35.0, 25.0, 15.0], (5000, 3))
    away = np.maximum(-points, points - [30.0, 20.0, 10.0])
    exact = np.where(
        away.max(axis=1) <= 0.0,
        -away.max(axis=1),
        -np.linalg.norm(np.maximum(away, 0.0), axis=1),
    )
    for wall in (surface_wall(vertices, faces), voxel_wall(mask, affine)):
        assert wall.measure_clearance(points) == pytest.approx(exact, abs=1e-9)
    assert MeshWall(vertices, faces).clearance(points) == pytest.approx(exact, abs=1e-9)
    inside = exact > 0.0
    boxes = VoxelWall(mask, affine).clearance(points[inside])
    assert boxes == pytest.approx(exact[inside], abs=1e-9)


@pytest.mark.parametrize("inflation", [0.0, 2.0])
def test_the_second_checker_finds_what_happens_between_steps(inflation):
    # A rod of 8 mm swings about its middle, past a corner of the box between its two steps.
    wall = surface_wall(*box([0.0, 0.0, 0.0], [30.0, 20.0, 10.0]))
    joints = np.array([[[1.0, 10, 5], [9, 10, 5]], [[9.0, 18, 5], [17, 18, 5]]])
    still = recheck_motion(joints[:1], wall, radius=0.5, inflation=inflation)
    assert still.found == pytest.approx(0.5 + inflation, abs=1e-9)
    middle = joints.mean(axis=0)[None]
    across = np.concatenate([joints[:1], middle + [0.0, 0.0, 8.0], joints[1:]])
    swung = recheck_motion(across, wall, radius=0.5, inflation=inflation, tolerance=0.01)
    assert swung.found == pytest.approx(-3.5 + inflation, abs=1e-6)
    assert swung.lower <= swung.found <= swung.lower + 0.01
    assert swung.step == pytest.approx(1.0)


def test_the_second_checker_wants_the_bore_within_the_lumen():
    wall = surface_wall(*box([0.0, 0.0, 0.0], [10.0, 10.0, 60.0]))
    place = {"entry": np.array([5.0, 5.0, 60.0]), "outward": np.array([0.0, 0.0, 1.0])}
    entry = {**place, "entry": np.array([5.0, 5.0, 55.0])}
    chains = np.array(
        [[[5.0, 5.0, head + 8.0 * k] for k in range(5)] for head in np.arange(55.0, 30.0, -1.0)]
    )
    good = recheck_motion(chains, wall, radius=2.0, tube=EntryTube(**entry, bore=5.0))
    assert good.clear and good.found == pytest.approx(3.0, abs=1e-6)
    wide = recheck_motion(chains, wall, radius=2.0, tube=EntryTube(**entry, bore=52.0))
    assert not wide.clear and wide.lower == pytest.approx(-47.0)
    assert not recheck_motion(chains, wall, radius=2.0, tube=EntryTube(**place, bore=5.0)).clear
    assert not recheck_motion(chains, wall, radius=2.0).clear
    # Beside the bore, or up through its side, nothing is free.
    aside = chains.copy()
    aside[:, 3:, 0] += 4.0
    assert recheck_motion(aside, wall, radius=2.0, tube=EntryTube(**entry, bore=5.0)).lower < -2.0


def test_an_archive_that_states_more_than_it_holds_is_refused(plan, tmp_path):
    path = plan.save(tmp_path / "plan.npz")
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as stream:
                if name != "joints":
                    np.lib.format.write_array(stream, array)
                    continue
                header = {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6, 3)}
                np.lib.format.write_array_header_1_0(stream, header)
    with pytest.raises(FileFormatError, match="is not a Bozzini plan"):
        Plan.load(path)


def test_an_archive_that_unpacks_to_too_much_is_refused(plan, tmp_path, monkeypatch):
    path = plan.save(tmp_path / "plan.npz")
    Plan.load(path)
    monkeypatch.setattr("bozzini.motion.plan.FILE_SIZE_MAX", 2**22)
    rewrite(path, joints=np.zeros((2**17, 2, 3)))
    assert path.stat().st_size < 2**18
    with pytest.raises(FileFormatError, match="MiB unpacked"):
        Plan.load(path)


def test_a_plan_called_complete_must_get_to_the_end_of_its_path(plan, tmp_path):
    half = plan.steps // 2
    short = replace(
        plan,
        joints=plan.joints[:half],
        head_arc_length=plan.head_arc_length[:half],
        clearance=plan.clearance[:half],
    )
    with pytest.raises(FileFormatError, match="status is 'complete', but the head gets to"):
        Plan.load(short.save(tmp_path / "plan.npz"))
    heads = short.head_arc_length * (plan.path_arc_length[-1] / short.head_arc_length[-1])
    with pytest.raises(FileFormatError, match="from the end of its path"):
        Plan.load(replace(short, head_arc_length=heads).save(tmp_path / "plan.npz"))
