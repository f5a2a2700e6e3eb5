"""How far a scope comes into every branch of a tree, and targets near it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bozzini import Scope
from bozzini.anatomy.airway import AirwayPhantom, make_airway
from bozzini.cli.main import main
from bozzini.duct import find_tree
from bozzini.errors import InputError
from bozzini.motion import certify_motion, plan_insertion
from bozzini.motion.approach import describe_routes, find_approaches
from bozzini.motion.branches import TreeReach, TreeReachOptions, reach_tree
from bozzini.motion.planners import PlannerOptions
from bozzini.motion.recheck import voxel_wall
from bozzini.motion.verify import verify_plan
from bozzini.numeric.polylines import measure_arc_length
from bozzini.study import Case
from bozzini.study.ends import choose_branch
from bozzini.study.jobs import open_row
from bozzini.study.tasks import choose_job
from tests.duct.branching import KnownTree, grow

VOXEL = 1.0
SCOPES = (Scope(diameter=6.0, link_length=4.0), Scope(diameter=4.0, link_length=4.0))


@cache
def open_airway(seed: int = 0) -> tuple[AirwayPhantom, Case]:
    phantom = make_airway(seed=seed)
    return phantom, Case.open(phantom.to_labels(VOXEL))


@cache
def reach_airway(seed: int = 0) -> TreeReach:
    _, case = open_airway(seed)
    return reach_tree(case.field, case.tree, scopes=SCOPES)


def allow_depth(phantom: AirwayPhantom, end: int, radius: float) -> float:
    """Return how far from the root the branches to one of them are wider than a radius [mm]."""
    route = [end]
    while phantom.branches[route[-1]].parent >= 0:
        route.append(phantom.branches[route[-1]].parent)
    depth = 0.0
    for number in route[::-1]:
        branch = phantom.branches[number]
        if branch.radius < radius:
            break
        depth += float(np.linalg.norm(branch.end - branch.start))
    return depth


def test_depths_are_those_that_the_radii_of_the_phantom_allow() -> None:
    """Never deeper than the tree is wide enough, and with short links nearly as deep."""
    phantom, case = open_airway()
    reached = reach_airway()
    for scope, ways in zip(SCOPES, reached.ways, strict=True):
        for way in ways:
            tip = case.tree.branches[way.branch].points[-1]
            gaps = [np.linalg.norm(phantom.branches[k].end - tip) for k in phantom.ends]
            end = phantom.ends[int(np.argmin(gaps))]
            if min(gaps) > 6.0:  # a branch that is not seen at this voxel
                continue
            most = allow_depth(phantom, end, scope.radius)
            # In a junction's ball the head gets beyond the end of the wide branch.
            assert way.depth <= most + 9.0
            least = allow_depth(phantom, end, scope.radius + 0.9 * VOXEL)
            assert way.depth >= 0.9 * least - 9.0


def test_every_motion_is_proved_by_another_look() -> None:
    """The certificate of each way holds for its joints in the field, and nothing else is said."""
    _, case = open_airway()
    seen = set()
    for scope, ways in zip(SCOPES, reach_airway().ways, strict=True):
        for way in ways:
            assert (way.plan is None) == math.isnan(way.clearance) or way.depth == 0.0
            if way.plan is None or id(way.plan) in seen:
                continue
            seen.add(id(way.plan))
            again = certify_motion(way.plan.joints, case.field, radius=scope.radius)
            inside = way.plan.joints[:, 0]
            assert way.clearance >= 0.0
            assert again.wall == way.plan.wall
            assert (case.field.signed_distance(inside) <= -scope.radius + 1e-6).all()
    assert len(seen) < sum(map(len, reach_airway().ways))  # ends behind one place share a motion


def test_a_branch_is_reached_as_far_as_the_best_way_through_it() -> None:
    reached = reach_airway()
    tree = reached.tree
    for number, ways in enumerate(reached.ways):
        rows = reached.rows[number * len(tree.branches) : (number + 1) * len(tree.branches)]
        for k, row in enumerate(rows):
            deepest = max(way.depth for way in ways if k in tree.list_route(way.branch))
            begin = tree.path(k).length - row.length
            assert row.reached == pytest.approx(np.clip(deepest - begin, 0.0, row.length), abs=1.01)
            assert bool(row.stop) == (not row.passed)
            assert bool(row.stop) == bool(row.reason)
            if row.generation:  # nobody comes into a branch whose parent is not passed
                parent = rows[tree.branches[k].parent]
                assert row.reached == 0.0 or parent.reached == pytest.approx(
                    parent.length, abs=1.01
                )


def test_what_stops_a_scope_is_told_of_each_end() -> None:
    """Also of ends that share a motion, and part where it stops."""
    _, case = open_airway()
    shared: dict[int, set[float | None]] = {}
    for ways in reach_airway().ways:
        for way in ways:
            if way.stop != "diameter" or way.offers is None:
                continue
            assert way.needs is not None and way.offers < way.needs
            line = case.tree.path(way.branch)
            bounds = case.field.clearance_bound(line.points)
            after = int(np.searchsorted(line.arc_length, way.depth + 1e-9))
            assert way.offers == pytest.approx(bounds[after])
            shared.setdefault(id(way.plan), set()).add(way.offers)
    assert any(len(offers) > 1 for offers in shared.values())


def test_a_thinner_scope_gets_as_far_or_farther() -> None:
    thick, thin = reach_airway().scopes
    for name in ("entered", "passed", "ends", "length", "volume", "near", "depth"):
        assert getattr(thin, name) >= getattr(thick, name)
    assert 0.0 < thick.volume < 1.0
    assert thick.near > thick.volume  # a needle of 20 mm gets beyond the branches' own territory
    assert thin.entered > thick.entered


def test_whole_way_is_that_of_a_plan_along_the_same_line() -> None:
    """Where the lumen is wide enough to the end of a branch a plan to it gets there too."""
    _, case = open_airway()
    scope = SCOPES[0]
    row = next(r for r in reach_airway().rows if r.generation == 1 and r.passed)
    found = case.change(branch=row.branch, method="tube").plan(scope, advise=False)
    assert found.plan.status == "complete"
    assert found.plan.certified
    assert found.line.length == pytest.approx(row.depth, abs=1.01)
    other = plan_insertion(case.field, case.tree.path(row.branch), scope=scope, method="tube")
    assert np.array_equal(other.joints, found.plan.joints)


def test_limit_of_the_joints_stops_the_scope_and_is_named() -> None:
    _, case = open_airway()
    tight = reach_tree(
        case.field,
        case.tree,
        scopes=SCOPES[:1],
        options=TreeReachOptions(planner=PlannerOptions(angle_limit=0.06)),
    )
    assert "angle" in {row.stop for row in tight.rows}
    assert tight.scopes[0].length < reach_airway().scopes[0].length


def test_approaches_are_those_of_brute_force() -> None:
    """500 targets in the box of the tree: the nearest place that the head gets to."""
    reached = reach_airway()
    random = np.random.default_rng(3)
    tree = reached.tree
    every = np.concatenate([branch.points for branch in tree.branches])
    targets = random.uniform(every.min(axis=0), every.max(axis=0), (500, 3))
    own = [row for row in reached.rows if row.diameter == SCOPES[1].diameter]
    places = []
    for branch, row in zip(tree.branches, own, strict=True):
        arc = measure_arc_length(branch.points)
        fine = np.append(np.arange(0.0, row.reached, 0.02), row.reached)
        fine = fine[: len(fine) if row.reached > 0.0 else 0]
        places.append(np.stack([np.interp(fine, arc, branch.points[:, k]) for k in range(3)], 1))
    cloud = np.concatenate(places)
    for target in targets:
        near = [
            each
            for each in find_approaches(reached, target, radius=2.0)
            if each.diameter == SCOPES[1].diameter
        ]
        truth = max(np.linalg.norm(cloud - target, axis=1).min() - 2.0, 0.0)
        assert truth - 0.01 <= near[0].needle <= truth + 0.13
        assert all(a.needle <= b.needle for a, b in zip(near, near[1:], strict=False))


def test_needles_keep_to_their_angle_and_measure_vessels() -> None:
    reached = reach_airway()
    target = reached.tree.branches[4].points[-1] + [12.0, 8.0, -10.0]
    free = find_approaches(reached, target)
    held = find_approaches(reached, target, most=math.radians(30.0))
    assert held[0].needle >= free[0].needle
    assert all(each.angle <= math.radians(30.0) + 1e-9 for each in held)
    vessels = target + np.array([[0.0, 0.0, 3.0]])
    (near, *_) = find_approaches(reached, target, vessels=vessels)
    assert near.vessels is not None and near.vessels <= 3.0
    (thick, *_) = find_approaches(reached, target, vessels=vessels, vessel_radius=0.5)
    assert thick.vessels == pytest.approx(max(near.vessels - 0.5, 0.0))
    far = find_approaches(reached, target, vessels=vessels + 500.0)[0].vessels
    assert far is not None and far > 100.0
    assert free[0].vessels is None


def test_route_turns_with_the_picture_and_is_mirrored() -> None:
    """The right bronchus is to the right if the front is up, to the left if the back is."""
    phantom, case = open_airway()
    tree = case.tree
    main = [branch for branch in tree.branches if branch.generation == 1]
    right = max(main, key=lambda branch: branch.points[-1, 0])
    left = min(main, key=lambda branch: branch.points[-1, 0])
    front = dict(zip(tree.names, describe_routes(tree, up=(0.0, 1.0, 0.0)), strict=True))
    back = dict(zip(tree.names, describe_routes(tree, up=(0.0, -1.0, 0.0)), strict=True))
    assert "right" in front[right.name] and "left" in back[right.name]
    assert "left" in front[left.name] and "right" in back[left.name]
    assert front["0"] == ""
    deep = max(tree.ends, key=lambda end: end.generation)
    assert len(front[deep.name].split(", ")) == deep.generation


def test_command_reaches_and_writes_a_table(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    from bozzini.anatomy.files import write_tract

    phantom, _ = open_airway()
    file = tmp_path / "airway.nii.gz"
    write_tract(file, phantom.to_labels(VOXEL))
    mark = tmp_path / "nodule.mrk.json"
    place = [40.0, 20.0, -30.0]
    point = {"position": [-place[0], -place[1], place[2]]}
    mark.write_text(
        json.dumps({"markups": [{"coordinateSystem": "LPS", "controlPoints": [point]}]})
    )
    line = ["reach", str(file), "--diameters", "6mm,4mm", "--link", "4mm"]
    answers = []
    table = str(tmp_path / "reach.csv")
    for more in (["--target", "40,20,-30", "--out", table], ["--target", str(mark)]):
        assert main([*line, *more, "--json", "--quiet"]) == 0
        answers.append(json.loads(capsys.readouterr().out))
    given, marked = answers
    assert given["approaches"] == marked["approaches"]
    assert given["needle_needed_mm"] == min(each["needle_mm"] for each in given["approaches"])
    reached = reach_airway()
    assert [each["depth_mm"] for each in given["scopes"]] == pytest.approx(
        [each.depth for each in reached.scopes]
    )
    assert len((tmp_path / "reach.csv").read_text().splitlines()) == 1 + len(reached.rows)


def test_picture_has_the_tree_of_each_scope_and_its_stops() -> None:
    reached = reach_airway()
    figure = reached.plot().figure
    assert [ax.get_title() for ax in figure.axes] == ["6 mm", "4 mm", ""]
    for ax, scope in zip(figure.axes, SCOPES, strict=False):
        own = [row for row in reached.rows if row.diameter == scope.diameter]
        drawn = [line for line in ax.lines if line.get_color() == "C0"]
        lengths = [float(np.ptp(line.get_ydata())) for line in drawn]
        assert lengths == pytest.approx([row.reached for row in own if row.reached > 0.0])
        marks = {line.get_label() for line in ax.lines if line.get_marker() == "v"}
        assert marks == {row.stop for row in own if row.stop and row.reached > 0.0}


def test_table_has_the_way_to_a_target_from_each_branch() -> None:
    reached = reach_airway()
    near = find_approaches(reached, (40.0, 20.0, -30.0))
    table = replace(reached, approaches=near).list_table()
    assert len(table["needle_mm"]) == len(reached.rows)
    assert sorted(x for x in table["needle_mm"] if x is not None) == sorted(a.needle for a in near)
    for row, needle in zip(reached.rows, table["needle_mm"], strict=True):
        assert (needle is None) == (row.reached <= 0.0)
    assert "needle_mm" not in reached.list_table()


def test_a_study_has_the_needle_to_a_target_among_its_outputs() -> None:
    """What a row gives as an input no output is called like."""
    assert {"near", "needle_needed", "ends", "depth"} <= set(choose_job("reach")({}).outputs)


def test_a_phantom_of_a_study_is_of_the_organ_that_is_named() -> None:
    _, case = open_airway()
    row = {"phantom": 0.0, "organ": "airway", "diameter": 3.5, "link_length": 5.0}
    opened, _ = open_row(row)
    assert np.array_equal(opened.field.values, case.field.values)
    with pytest.raises(InputError, match="no phantom of .colon."):
        open_row({**row, "organ": "colon"})


def test_what_never_enters_says_why() -> None:
    _, case = open_airway()
    huge, stiff = (Scope(diameter=60.0, link_length=5.0), Scope(diameter=4.0, link_length=500.0))
    found = reach_tree(case.field, case.tree, scopes=(huge, stiff))
    assert not found.converged and found.depth == 0.0
    assert {way.stop for way in found.ways[0]} == {"diameter"}
    assert {way.stop for way in found.ways[1]} == {"link"}
    assert "too narrow beyond 0.0 mm" in found.reason
    assert all(math.isnan(row.clearance) for row in found.rows)


def test_wrong_input_is_one_line() -> None:
    _, case = open_airway()
    with pytest.raises(InputError, match="there is no branch 'x'"):
        _ = case.change(branch="x").line
    with pytest.raises(InputError, match="branch cannot be used with end"):
        case.change(branch="0", end=(0.0, 0.0, 0.0))
    with pytest.raises(InputError, match="diameters are 4, 4 mm: each must be there once"):
        reach_tree(case.field, case.tree, scopes=[SCOPES[1], SCOPES[1]])
    with pytest.raises(InputError, match="needle angle"):
        find_approaches(reach_airway(), (0.0, 0.0, 0.0), most=4.0)


def test_a_branch_is_chosen_by_its_name_in_anatomy(tmp_path) -> None:  # type: ignore[no-untyped-def]
    _, case = open_airway()
    names = tmp_path / "names.csv"
    names.write_text("branch,name\n0.1,LMB\n")
    named = case.change(branch="lmb", names=str(names))
    plain = case.change(branch="0.1")
    assert np.array_equal(named.line.points, plain.line.points)
    scope = Scope(diameter=3.0, link_length=4.0)
    plans = [each.plan(scope, advise=False) for each in (named, plain)]
    stated = [
        each.case.state(each.plan, centreline=each.centreline, findings=()).input for each in plans
    ]
    assert stated[0] == stated[1]


def check_random_tree(seed: int) -> None:
    """Branches, depths and certificates of a random tree of tubes, by its known truth."""
    known = grow(seed, splits=3, radius=6.0)
    voxel = 0.8
    duct = known.rasterise(voxel)
    tree = find_tree(duct, known.start[0])
    assert len(tree.branches) == len(known.parent)
    assert len(tree.ends) == len(known.ends)
    scope = Scope(diameter=2.0 * float(np.quantile(known.radius, 0.4)), link_length=2.0)
    (ways,) = reach_tree(duct, tree, scopes=(scope,)).ways
    for way in ways:
        tip = tree.branches[way.branch].points[-1]
        route = [min(known.ends, key=lambda k: float(np.linalg.norm(known.end[k] - tip)))]
        while known.parent[route[0]] >= 0:
            route.insert(0, known.parent[route[0]])
        lengths = np.linalg.norm(known.end[route] - known.start[route], axis=1)
        narrow = known.radius[route] < scope.radius
        most = float(lengths[: int(np.argmax(narrow))].sum() if narrow.any() else lengths.sum())
        # In the ball at a branching the head gets on beyond the wide tube's end.
        assert way.depth <= most + known.radius[0]
        # Half a diagonal of a voxel at the wall, half a voxel off the middle.
        tight = known.radius[route] < scope.radius + 1.5 * voxel
        least = float(lengths[: int(np.argmax(tight))].sum() if tight.any() else lengths.sum())
        assert way.depth >= 0.9 * least - known.radius[0] - 2.0
        if way.plan is not None:
            checked = verify_plan(way.plan, duct, wall=voxel_wall(*known.label(voxel)))
            faults = [each.message for each in checked.checks if not each.ok]
            proof, second = checked.certificate, checked.recheck
            assert proof is not None and proof.certified
            # The second check resolves 0.05 mm: at less clearance it shows no more than no fault.
            assert second is not None and second.found > 0.0 and second.lower >= -0.05
            assert not faults or second.found < 0.06, faults
            # The body keeps off the true wall, but for what the voxels hide.
            body = way.plan.joints[:, 0][known.measure(way.plan.joints[:, 0]) < 0.0]
            assert known.measure(body).max() <= -scope.radius + 0.87 * voxel


@pytest.mark.parametrize("seed", range(4))
def test_random_trees_are_reached_as_their_truth_allows(seed: int) -> None:
    check_random_tree(seed)


def test_a_tree_from_a_file_has_the_same_reach(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    from bozzini.anatomy.files import write_tract

    phantom, case = open_airway()
    file, swc = tmp_path / "airway.nii.gz", tmp_path / "tree.swc"
    write_tract(file, phantom.to_labels(VOXEL))
    assert main(["tree", str(file), "--out", str(swc)]) == 0
    capsys.readouterr()
    assert main(["tree", str(swc), "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["branches"]) == len(case.tree.branches)
    line = ["reach", str(file), "--tree", str(swc), "--diameter", "6mm", "--link", "4mm"]
    assert main([*line, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["depth_mm"] == pytest.approx(reach_airway().scopes[0].depth, abs=0.01)
    lines = tmp_path / "tree.vtp"
    assert main(["tree", str(file), "--out", str(lines)]) == 0
    assert main(["tree", str(file), "--out", str(tmp_path / "tree.mrk.json")]) == 0
    start = ",".join(f"{value:.3f}mm" for value in case.tree.ends[0].points[-1])
    capsys.readouterr()
    first = []
    for each in (lines, tmp_path / "tree.mrk.json"):
        assert main(["tree", str(each), f"--start={start}", "--json"]) == 0
        first.append(json.loads(capsys.readouterr().out)["branches"][0]["points_mm"][0])
    assert first[0] == pytest.approx(case.tree.ends[0].points[-1], abs=0.01)
    assert first[1] == pytest.approx(first[0], abs=0.01)
    for wrong, said in (("--labels=1", "it has no labels"), ("--start=trachea", "a point x,y,z")):
        assert main(["tree", str(lines), wrong, "--json"]) == 2
        assert said in capsys.readouterr().out
    swc.write_text("1 0 0 0 500 1 -1\n2 0 0 0 501 1 1\n")
    assert main([*line, "--json"]) == 2
    assert "lies outside the lumen" in capsys.readouterr().out


def test_branches_that_touch_at_their_ends_are_reached_up_to_there() -> None:
    """Their loop leaves the tree without an end: the scope is planned to where it closes."""
    corners = np.array([[0, 0, 50], [0, 0, 0], [6, 0, -12], [-6, 0, -12], [2.7, 0, -50],
                        [-2.7, 0, -50]], dtype=float)  # fmt: skip
    known = KnownTree(
        start=corners[[0, 1, 1, 2, 3]],
        end=corners[[1, 2, 3, 4, 5]],
        radius=np.array([5.0, 3.0, 3.0, 2.8, 2.8]),
        parent=(-1, 0, 0, 1, 2),
    )
    field = known.rasterise(1.0, offset=0.2)
    tree = find_tree(field)
    assert [item.code for item in tree.findings] == ["loop"]
    assert not tree.ends
    found = reach_tree(field, tree, scopes=[Scope(diameter=2.0, link_length=4.0)])
    assert len(found.ways[0]) == len(tree.tips) == 2
    assert math.isnan(found.ends)
    assert all(row.reached > 0.9 * row.length for row in found.rows)
    tract = open_airway()[1].tract
    line = choose_branch(tract, tree, None, start=None).line
    assert line.length == max(tree.path(tip).length for tip in tree.tips)


def test_a_short_branch_that_is_not_entered_is_not_passed() -> None:
    row = reach_airway().rows[0]
    assert row.passed
    assert not replace(row, length=0.7, reached=0.0).passed
    for each in reach_airway().rows:
        assert each.passed == (each.stop == "")


def test_what_is_odd_about_an_input_and_a_target_is_told(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    """Voxels that are not joined with the lumen, and a target that no needle gets to."""
    import nibabel as nib

    mask, affine = grow(3, 2).label(1.0)
    mask[1, 1, 1:4] = True
    nib.save(nib.Nifti1Image(mask.astype(np.uint8), affine), tmp_path / "loose.nii.gz")
    name = str(tmp_path / "loose.nii.gz")
    assert main(["tree", name, "--json"]) == 0
    assert "components-dropped" in _list_codes(capsys)
    command = ["reach", name, "--link", "4mm", "--json"]
    assert main([*command, "--target", "0mm,0mm,-20mm"]) == 0
    assert "target-far" not in _list_codes(capsys)
    assert main([*command, "--target", "500mm,0mm,0mm"]) == 0
    assert _list_codes(capsys)[0] == "target-far"
    assert main([*command, "--target", "0mm,0mm,500mm", "--needle-angle", "1deg"]) == 0
    assert {"target-far", "components-dropped"} < set(_list_codes(capsys))


def test_thin_ends_have_one_line_together(tmp_path, capsys) -> None:  # type: ignore[no-untyped-def]
    """In JSON each is a finding."""
    import nibabel as nib

    mask = np.zeros((60, 21, 60), dtype=np.uint8)
    mask[:, 8:13, 8:13] = 1
    mask[5::10, 10, 13:40] = 1
    name = str(tmp_path / "comb.nii.gz")
    nib.save(nib.Nifti1Image(mask, np.eye(4)), name)
    assert main(["tree", name]) == 0
    (line,) = [text for text in capsys.readouterr().out.splitlines() if "than a voxel" in text]
    assert main(["tree", name, "--json"]) == 0
    count = _list_codes(capsys).count("thin-end")
    assert count > 3
    assert line.startswith(f"note: {count} ends are no wider")
    assert line.endswith(", ...") and line.count("'") == 6


def _list_codes(capsys) -> list[str]:  # type: ignore[no-untyped-def]
    return [item["code"] for item in json.loads(capsys.readouterr().out)["findings"]]
