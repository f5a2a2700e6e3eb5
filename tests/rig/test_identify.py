"""Identification: laws integrated by another route are found again; measured curves; odd files."""

from __future__ import annotations

import functools

import numpy as np
import pandas
import pytest
from scipy.integrate import solve_ivp
from scipy.io import loadmat, savemat
from scipy.optimize import brentq

from bozzini.errors import BozziniError, InputError
from bozzini.io.matlab import read_matrices
from bozzini.rig import ATMOSPHERE, Chamber, Orifice, Plant, PlantDesign
from bozzini.rig.curves import PressureCurve, read_curve, take_curve
from bozzini.rig.identify import Identification, identify_fill, identify_leak, regulated_flow

START, SUPPLY = 0.015, 0.63
WHOLE = SUPPLY + ATMOSPHERE
PSI = 0.45359237 * 9.80665 / 25.4**2


def make_curve(time, pressure, name="made"):
    return PressureCurve(name=name, time=time, pressure=pressure)


def find_share(ratio, critical, droop):
    """The flow behind a regulator, from the equation that defines it."""
    share = Orifice(area=1.0, critical_ratio=critical).find_share

    def excess(flow):
        before = 1.0 - droop * flow
        return before * float(share(min(ratio / before, 1.0))) - flow if before > ratio else -flow

    return brentq(excess, 0.0, 1.0, xtol=1e-14)


@functools.cache
def tabulate_flows(critical, droop):
    grid = np.linspace(0.0, 1.0, 300)
    return grid, np.array([find_share(r, critical, droop) for r in grid])


def integrate_fill(time, *, tau, droop=0.0, critical=0.528, growth=0.0, upstream=False):
    """A fill in time, of the gas inside: d(p V)/dt is the flow."""
    grid, flows = tabulate_flows(critical, droop)

    def volume(pressure):
        return (1.0 + growth / (1.0 + np.exp(-(pressure - 0.15) / 0.06))) / (1.0 + growth)

    over = np.linspace(0.0, SUPPLY, 4000)
    gas_over = (over + ATMOSPHERE) * volume(over)

    def rate(_, gas):
        pressure = np.interp(gas[0], gas_over, over)
        return [WHOLE / tau * np.interp((pressure + ATMOSPHERE) / WHOLE, grid, flows)]

    begin = (START + ATMOSPHERE) * volume(START)
    found = solve_ivp(rate, (0.0, time[-1]), [begin], t_eval=time, rtol=1e-8, max_step=0.02)
    pressure = np.interp(found.y[0], gas_over, over)
    if upstream:
        ratio = (pressure + ATMOSPHERE) / WHOLE
        pressure = WHOLE * (1.0 - droop * np.interp(ratio, grid, flows)) - ATMOSPHERE
        pressure[0] = START
    return pressure


TIME = np.arange(0.0, 2.5, 0.01)


@pytest.fixture(scope="module")
def grown():
    """Give a fill of a muscle whose volume grows to four times its own."""
    return make_curve(TIME, integrate_fill(TIME, tau=0.4, droop=0.8, growth=3.0))


@pytest.mark.parametrize("critical", [0.2, 0.528])
@pytest.mark.parametrize("droop", [0.0, 0.3, 3.0])
def test_regulated_flow_solves_its_equation(critical, droop) -> None:
    ratios = np.linspace(0.0, 0.985, 60)
    expected = np.array([find_share(ratio, critical, droop) for ratio in ratios])
    # The end of the ellipse is linear in `Orifice`, and not here.
    inside = ratios < 0.98 * (1.0 - droop * expected)
    assert inside.sum() > 20
    found = regulated_flow(ratios, critical, droop)
    assert found[inside] == pytest.approx(expected[inside], abs=1e-9)
    assert np.all(np.diff(found) <= 0.0)
    assert regulated_flow(np.array([1.0]), critical, droop) == pytest.approx(0.0, abs=1e-12)


def test_orifice_is_found_from_the_closed_form() -> None:
    orifice = Orifice(area=0.5, critical_ratio=0.35)
    pressure = np.linspace(START, 0.995 * SUPPLY, 400)
    clock = orifice.fill_time(2e4, SUPPLY, end=pressure, start=START)
    over = np.linspace(0.0, clock[-1], 150)
    fit = identify_fill([make_curve(over, np.interp(over, clock, pressure))]).fits[0]
    assert fit.law == "orifice"
    assert fit.converged
    assert fit.constants["time constant"] == pytest.approx(orifice.time_constant(2e4), rel=0.02)
    assert fit.find_area(2e4) == pytest.approx(orifice.area, rel=0.02)
    assert fit.constants["critical ratio"] == pytest.approx(0.35, abs=0.03)
    assert fit.constants["supply"] == pytest.approx(SUPPLY, rel=5e-3)
    assert abs(fit.time_error) < 5e-3


def test_plant_s_own_time_constant_is_found() -> None:
    over = np.linspace(0.0, 1.2, 241)
    chamber = Chamber(pressure=over, volume=np.full(241, 200.0), contraction=over)
    design = PlantDesign(reservoir_volume=1e8, reservoir_pressure=SUPPLY, compressor_flow=0.0,
                         pipette_length=0.0, tube_length=3000.0)  # fmt: skip
    plant = Plant(chamber, design)
    rows = []
    for _ in range(600):
        rows.append((plant.time, plant.pressures[0]))
        plant.step(np.eye(6)[0], 2e-3)
    fit = identify_fill([make_curve(*np.array(rows).T)]).fits[0]
    opening = (1.0 - 0.02 - design.valve_dead_zone) / (1.0 - design.valve_dead_zone)
    tau = design.fill_valve.time_constant(design.line_volume + 200.0) / opening
    assert fit.law == "orifice"
    assert fit.constants["time constant"] == pytest.approx(tau, rel=0.03)
    assert fit.constants["critical ratio"] == pytest.approx(design.critical_ratio, abs=0.05)


def test_regulator_and_growing_volume_are_found(grown) -> None:
    plain = make_curve(TIME, integrate_fill(TIME, tau=0.4, droop=0.8))
    found = identify_fill([plain, grown])
    first, second = found.fits
    assert (first.law, second.law) == ("regulator", "growing")
    for fit in found.fits:
        assert fit.constants["time constant"] == pytest.approx(0.4, rel=0.05)
        assert fit.constants["droop"] == pytest.approx(0.8, rel=0.08)
        assert abs(fit.time_error) < 5e-3
    assert second.constants["growth"] == pytest.approx(3.0, rel=0.2)
    assert second.constants["growth pressure"] == pytest.approx(0.15, abs=0.01)
    assert found.residual < 1e-3


def test_transducer_before_the_orifice_is_recognised() -> None:
    pressure = integrate_fill(TIME, tau=0.8, droop=0.4, upstream=True)
    fit = identify_fill([make_curve(TIME, pressure)]).fits[0]
    assert fit.law == "upstream"
    assert fit.constants["droop"] == pytest.approx(0.4, rel=0.05)
    assert fit.constants["time constant"] == pytest.approx(0.8, rel=0.05)
    assert fit.predict(TIME) == pytest.approx(pressure, abs=0.02)


def test_supply_that_was_measured_is_held() -> None:
    short = TIME[:60]
    pressure = integrate_fill(short, tau=0.6, droop=0.8)
    assert pressure[-1] < 0.9 * SUPPLY
    table = {"time [s]": short, "pressure [MPa]": pressure, "supply [MPa]": SUPPLY}
    fit = identify_fill([take_curve(pandas.DataFrame(table))]).fits[0]
    assert fit.constants["supply"] == pytest.approx(SUPPLY, abs=2e-6)
    assert fit.constants["time constant"] == pytest.approx(0.6, rel=0.05)
    low = take_curve(pandas.DataFrame(table | {"supply [MPa]": 0.2}))
    with pytest.raises(InputError, match="the supply is 0.2 MPa, below"):
        identify_fill([low])


def test_leaks_are_found() -> None:
    orifice = Orifice(area=1e-4)
    pressure = np.linspace(0.6, 0.15, 300)
    clock = orifice.vent_time(3e4, 0.6, end=pressure)
    time = np.linspace(0.0, clock[-1], 200)
    choked = np.interp(time, clock, pressure) + 0.01 * np.exp(-time / (0.05 * time[-1]))
    tau = 300.0

    def rate(_, p):
        return -((p + ATMOSPHERE) ** 2 - ATMOSPHERE**2) / (2.0 * ATMOSPHERE * tau)

    narrow = solve_ivp(rate, (0.0, 400.0), [0.6], t_eval=np.linspace(0, 400, 200), rtol=1e-9)
    found = identify_leak([make_curve(time, choked), make_curve(narrow.t, narrow.y[0])])
    assert [fit.law for fit in found.fits] == ["orifice leak", "laminar leak"]
    taus = [fit.constants["time constant"] for fit in found.fits]
    assert taus == pytest.approx([orifice.time_constant(3e4), tau], rel=0.03)
    assert found.worst_time_error < 0.01
    assert found.fits[0].find_area(3e4) == pytest.approx(1e-4, rel=0.03)
    with pytest.raises(InputError, match="no effective area"):
        found.fits[1].find_area(3e4)


def test_constants_do_not_depend_on_clock_unit_or_sampling(grown) -> None:
    random = np.random.default_rng(1)
    fine = np.arange(0.0, 2.49, 1e-3)
    dense = np.interp(fine, TIME, grown.pressure) + random.normal(0.0, 1e-3, fine.size)
    wait = np.concatenate([np.arange(0.0, 0.5, 0.01), 0.5 + TIME])
    late = np.concatenate([np.full(50, START), grown.pressure])
    variants = {
        "later": make_curve(TIME + 1e3, grown.pressure),
        "pre-trigger": make_curve(wait, late),
        "fine and noisy": make_curve(fine, dense),
        "coarse and offset": make_curve(TIME[::3], grown.pressure[::3] + 0.02),
        "no plateau": make_curve(TIME[:100], grown.pressure[:100]),
    }
    psi = pandas.DataFrame({"time [ms]": 1e3 * TIME, "pressure [psi]": grown.pressure / PSI})
    assert take_curve(psi).time == pytest.approx(grown.time)
    assert take_curve(psi).pressure == pytest.approx(grown.pressure)
    reference, *others = identify_fill([grown, *variants.values()]).fits
    for name, fit in zip(variants, others, strict=True):
        assert fit.law == "growing", name
        assert abs(fit.time_error) < 0.02, name
        same = reference.measured_time if name != "no plateau" else fit.model_time
        assert fit.measured_time == pytest.approx(same, rel=0.02), name
    # Without the plateau the supply is extrapolated.
    assert grown.pressure[99] < 0.96 * SUPPLY
    assert others[-1].constants["supply"] == pytest.approx(SUPPLY, rel=0.05)


def test_rest_of_a_curve_follows_from_its_beginning(grown) -> None:
    curves = [
        make_curve(TIME, integrate_fill(TIME, tau=tau, droop=0.8, growth=3.0)) for tau in (0.3, 0.5)
    ]
    known = identify_fill(curves)
    checked = known.check([grown], share=0.6)
    assert known.checks == ()
    assert checked.checks[0].used == 0.6
    assert checked.worst_time_error < 0.03
    # What lies beyond the share used has no influence.
    cut = grown.time <= np.interp(0.7 * SUPPLY, grown.pressure, grown.time)
    bent = np.where(cut, grown.pressure, np.maximum(grown.pressure - 0.02, 0.7 * SUPPLY))
    other = known.check([make_curve(TIME, bent)], share=0.6).checks[0]
    assert other.constants == pytest.approx(checked.checks[0].constants, rel=0.05, abs=1e-3)


def test_what_no_law_describes_is_reported(grown) -> None:
    stairs = np.where(TIME < 1.0, 0.1, np.where(TIME < 2.0, 0.3, 0.6)) + 1e-3 * TIME
    found = identify_fill([make_curve(TIME, stairs, "stairs"), grown])
    assert not found.converged
    assert found.reason.startswith("stairs: no law fits")
    assert found.fits[1].converged
    few = np.interp(np.linspace(0, 2.4, 13), TIME, grown.pressure)
    checked = Identification(kind="fill", fits=found.fits[1:]).check(
        [make_curve(np.linspace(0, 2.4, 13), few, "few")]
    )
    assert not checked.converged
    assert "at least 10 are needed" in checked.reason


def test_result_is_a_table_a_dictionary_and_a_picture(grown) -> None:
    found = identify_fill([grown]).check([grown])
    frame = found.to_frame()
    assert list(frame["part"]) == ["fit", "check"]
    assert frame["time_constant_s"][0] == found.fits[0].constants["time constant"]
    assert found.to_dict()["converged"]
    assert found.fits[0].to_dict()["residual_MPa"] == found.fits[0].residual
    assert len(found.plot().lines) == 4


def check_halves(found, limit):
    """Check each half of the curves by the fits of the other; return the names refused."""
    described = [fit.time_error for fit in found.fits if fit.converged]
    assert np.abs(described).max() < 0.02
    for first in (0, 1):
        known = Identification(kind=found.kind, fits=found.fits[first::2])
        checked = known.check([fit.curve for fit in found.fits[1 - first :: 2]]).checks
        errors = {fit.curve.name: fit.time_error for fit in checked if fit.converged}
        assert max(map(abs, errors.values())) < limit, errors
        yield [fit.curve.name for fit in checked if not fit.converged]


@pytest.fixture(scope="module")
def fills(festo10_dir):
    """Give the laws of all measured fills."""
    return identify_fill([read_curve(path) for path in sorted(festo10_dir.glob("fill/*.mat"))])


def extend_line(curve, share):
    """Error of the time to 90 % by a straight line through the last tenth of a beginning."""
    levels = np.array([0.05, share - 0.1, share, 0.9])
    smooth = np.maximum.accumulate(curve.pressure)
    end = np.median(curve.pressure[-4:])
    times = np.interp(smooth[0] + levels * (end - smooth[0]), smooth, curve.time)
    line = times[2] + (times[2] - times[1]) * (0.9 - share) / 0.1
    return (line - times[0]) / (times[3] - times[0]) - 1.0


def test_measured_fills_carry_over_within_ten_per_cent(fills) -> None:
    # The third steps to 450 kPa in 60 ms and then falls: its transducer is before a restriction.
    assert list(check_halves(fills, 0.10)) == [[], ["Experiment3Fill.mat"]]
    assert [fit.curve.name for fit in fills.fits if not fit.converged] == ["Experiment3Fill.mat"]


def test_law_predicts_better_than_a_straight_line(fills) -> None:
    good = [fit for fit in fills.fits if fit.converged]
    known = Identification(kind="fill", fits=tuple(good[::2]))
    curves = [fit.curve for fit in good[1::2]]
    errors = [abs(fit.time_error) for fit in known.check(curves, share=0.7).checks]
    lines = [abs(extend_line(curve, 0.7)) for curve in curves]
    assert np.mean(errors) < 0.5 * np.mean(lines)


def test_measured_leaks_carry_over_within_ten_per_cent(festo10_dir) -> None:
    curves = [read_curve(path) for path in sorted(festo10_dir.glob("leak/*.mat"))]
    found = identify_leak(curves)
    assert {fit.law for fit in found.fits} == {"orifice leak"}
    assert list(check_halves(found, 0.10)) == [[], []]


def test_matlab_files_are_read(tmp_path) -> None:
    rows = np.column_stack([TIME, 600.0 * (1.0 - np.exp(-3.0 * TIME))])
    savemat(tmp_path / "a.mat", {"data": rows, "other": rows[:9], "note": "text"})
    savemat(tmp_path / "b.mat", {"only": rows.T.copy()})
    first, second = (read_curve(tmp_path / name) for name in ("a.mat", "b.mat"))
    assert np.array_equal(first.pressure, second.pressure)
    assert first.pressure[-1] == pytest.approx(1e-3 * rows[-1, 1])
    counts = np.column_stack([500 * np.arange(40), np.arange(40) < 5, 800 - 5 * np.arange(40)])
    savemat(tmp_path / "c.mat", {"data": counts.astype(np.int32)})
    leak = read_curve(tmp_path / "c.mat", supply=0.5)
    assert leak.time[0] == 2.5
    assert leak.pressure[0] == pytest.approx(0.5 * 775 / 800)
    assert len(leak.notes) == 3


def test_tables_state_their_units() -> None:
    table = pandas.DataFrame(
        {"time [ms]": 10 * np.arange(20), "Pressure [bar]": np.arange(20.0), "supply [MPa]": 2.0}
    )
    below = table.astype(object).set_axis(["Time", "Pressure", "supply"], axis=1)
    below.loc[-1] = ["ms", "bar", "MPa"]
    for curve in (take_curve(table), take_curve(below.sort_index())):
        assert curve.time[-1] == pytest.approx(0.19)
        assert curve.supply == 2.0
    curve = take_curve(table)
    assert curve.pressure[-1] == pytest.approx(1.9)
    assert curve.supply == 2.0
    assert len(curve.plot().lines) == 1


def odd_files(folder):
    """Write wrong files; return their names and what the message has."""
    rows = np.column_stack([TIME, np.linspace(0.0, 600.0, TIME.size)])
    nothing = {"a": rows, "b": rows}
    for name, content in {
        "two.mat": nothing,
        "text.mat": {"data": "words"},
        "deep.mat": {"data": np.zeros((20, 2, 2))},
        "wide.mat": {"data": np.zeros((20, 5))},
        "complex.mat": {"data": 1j * rows},
        "nan.mat": {"data": np.where(rows > 300.0, np.nan, rows)},
        "back.mat": {"data": rows[::-1]},
        "short.mat": {"data": rows[:5]},
        "large.mat": {"data": rows * [1.0, 1e6]},
        "shut.mat": {"data": np.insert(rows, 1, 0.0, axis=1)},
        "empty.mat": {},
    }.items():
        savemat(folder / name, content)
    (folder / "junk.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(range(256)))
    (folder / "none.mat").write_bytes(b"")
    hdf = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(400)
    (folder / "new.mat").write_bytes(hdf)
    (folder / "words.csv").write_text("time,pressure\n" + "a,b\n" * 20)
    (folder / "columns.csv").write_text("t,p\n" + "1,2\n" * 20)
    (folder / "unit.csv").write_text("time [s],pressure [mm]\n" + "1,2\n" * 20)
    (folder / "blank.csv").write_text("time [s],pressure [kPa],\n" + "1,2,3\n" * 20)
    (folder / "twice.csv").write_text("time [s],pressure [kPa],Pressure\n" + "1,2,3\n" * 20)
    (folder / "a.txt").write_text("1 2")
    return {
        "two.mat": "the variables a, b", "text.mat": "no real numbers", "deep.mat": "have shape",
        "wide.mat": "have shape", "complex.mat": "no real numbers", "nan.mat": "not finite",
        "back.mat": "must rise", "short.mat": "at least 12", "large.mat": "pressure",
        "shut.mat": "never moves", "empty.mat": "no variables", "junk.mat": "MATLAB",
        "none.mat": "MATLAB", "new.mat": "7.3", "words.csv": "row 2: .* finite number",
        "columns.csv": "no column 'time'", "unit.csv": "wrong kind", "twice.csv": "two columns",
        "blank.csv": "column 3 has no title", "a.txt": "must end in",
        "missing.mat": "no such file",
    }  # fmt: skip


def test_odd_files_are_one_line(tmp_path) -> None:
    long = {f"{'x' * 300}.csv": "no such file"}
    for name, words in (odd_files(tmp_path) | long).items():
        with pytest.raises(BozziniError, match=words) as caught:
            read_curve(tmp_path / name)
        assert "\n" not in str(caught.value), name
        assert name.split(".")[0] in str(caught.value)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda c: identify_fill([]), "no curves"),
        (lambda c: identify_leak([c]), "must fall"),
        (lambda c: identify_fill([make_curve(TIME, np.full(TIME.size, 0.1))]), "must rise"),
        (lambda c: identify_fill([c]).check([c], share=0.95), "share is 0.95"),
        (lambda c: identify_fill([c]).check([make_curve(TIME, c.pressure[::-1])]), "must rise"),
    ],
)
def test_wrong_input_is_one_line(grown, call, words) -> None:
    with pytest.raises(InputError, match=words) as caught:
        call(grown)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("kind", ["<f8", ">f8", "<i2", "<u1", "<f4"])
@pytest.mark.parametrize("packed", [False, True])
def test_matlab_reader_agrees_with_scipy(tmp_path, kind, packed) -> None:
    values = (np.arange(60).reshape(20, 3) * 3).astype(kind)
    savemat(tmp_path / "a.mat", {"data": values, "a": [1, 2]}, do_compression=packed)
    found = read_matrices(tmp_path / "a.mat")
    assert np.array_equal(found["data"], loadmat(tmp_path / "a.mat")["data"])
    assert found["data"].dtype.kind == values.dtype.kind
    assert found["a"].shape == (1, 2)


def test_matlab_reader_agrees_with_scipy_on_measured_files(festo10_dir) -> None:
    for path in sorted(festo10_dir.glob("*/*.mat")):
        assert np.array_equal(read_matrices(path)["data"], loadmat(path)["data"])


def test_damaged_matlab_files_are_one_line(tmp_path) -> None:
    path = tmp_path / "a.mat"
    random = np.random.default_rng(0)
    sound = np.column_stack([TIME, TIME])
    for packed in (False, True):
        savemat(path, {"data": sound}, do_compression=packed)
        whole = path.read_bytes()
        for _ in range(60):
            damaged = bytearray(whole[: random.integers(1, len(whole) + 1)])
            for place in random.integers(0, min(len(damaged), 260), 3):
                damaged[place] = random.integers(0, 256)
            path.write_bytes(damaged)
            try:
                read_matrices(path)
            except BozziniError as error:
                assert "\n" not in str(error)
