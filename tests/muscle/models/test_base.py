"""What every model of the catalogue does: its card, its arguments, its roots and its refusals."""

from __future__ import annotations

import math
import pickle
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bozzini.checks import list_quantities
from bozzini.errors import InputError, MissingLawError
from bozzini.muscle import (
    MODELS,
    ConvergenceError,
    Measurements,
    Muscle,
    MuscleModel,
    RankOptions,
    rank,
)
from bozzini.muscle.models import (
    Card,
    CatalogueModel,
    Choice,
    Law,
    Parameter,
    count_statuses,
)
from bozzini.muscle.models.card import BRAID_FIELDS, STATUSES
from bozzini.numeric import roots
from tests.muscle.models.catalogue import MUSCLE, SURVEY, build
from tests.muscle.models.relations import ask_anything
from tests.muscle.strategies import muscles

OWN = [
    "gaylord-1", "gaylord-2", "chou", "tondu-lopez", "itto-a", "itto-b", "davis-caldwell",
    "meller", "andrikopoulos", "andrikopoulos-thermal", "schulte", "ferraresi", "kothera-balance",
]  # fmt: skip


def make_card(name: str, **rest) -> Card:
    return Card(
        name=name, title="A toy", authors="Nobody", reference="Nowhere", equation="(0)",
        status="fitted", latex="F", **rest,
    )  # fmt: skip


class Toy(CatalogueModel):
    """Any function of strain, times pressure; a law, a choice and numbers to give."""

    card = make_card(
        "toy",
        parameters=(
            Parameter("rub [N]", "friction", (0.0, 5.0), default=0.0, neutral=0.0, linear=True),
            Parameter("heat [K]", "heat", (0.0, 9.0), source="measured", only_with="rub"),
        ),
        choices=(Choice(name="way", what="way", words=("new", "old"), printed="old"),),
        laws=(
            Law("shape [N/MPa]", ("strain",), "the pull per pressure", "Nobody (1900)"),
            Law("extra [N]", ("strain",), "more", "Nobody (1901)", only_with="rub"),
        ),
    )  # fmt: skip

    def _pull(self, pressure, length):
        return pressure * self._call("shape", 1.0 - length / self.braid.length)

    def _friction(self, pressure, length):
        return np.full(pressure.shape, self.parameters["rub"])


def ramp(strain):
    return 1.0 - 4.0 * strain


@pytest.fixture(params=OWN)
def model(request):
    return build(request.param)


def test_the_catalogue_is_by_name_and_apart_from_our_own_models():
    assert set(OWN) <= set(SURVEY)
    assert set(MODELS) == {*SURVEY, "energy", "thesis"}
    for name, kind in SURVEY.items():
        assert kind.card.name == kind.name == name
        assert set(kind.unused) == set(list_quantities(Muscle)) - set(kind.card.uses)
        for words in (kind.card.reference, kind.card.latex, kind.card.equation, kind.card.status,
                      *kind.card.keywords, *kind.card.errata):  # fmt: skip
            assert words and words in kind.__doc__
        assert (kind.card.status == "partial") <= bool(kind.card.missing)
        assert kind.card.latex_printed is None or kind.card.errata
        assert kind.card.unprintable == "" or kind.card.latex_printed


def test_a_model_is_a_model(model):
    assert isinstance(model, MuscleModel)
    again = pickle.loads(pickle.dumps(model))
    assert again == model and hash(again) == hash(model)
    assert np.array_equal(again.contraction(0.5), model.contraction(0.5))
    assert model.replace() == model
    assert model.replace(MUSCLE.replace(length=50.0)) != model
    assert model.replace(as_printed=False).as_printed is False
    with pytest.raises(AttributeError):
        model.muscle = MUSCLE


def test_unused_fields_make_no_difference_and_the_others_do(model):
    friction = {"friction": 0.01} if "friction" in model.card.keywords else {}
    if "strand_poisson_ratio" in model.card.keywords:
        friction["strand_poisson_ratio"] = 0.4
    if "inflation_pressure" in model.card.keywords:
        friction["inflation_pressure"] = lambda radius: 0.1 * radius
    constants = {**model.keywords, **friction}

    def answer(muscle):
        state = type(model)(muscle, **constants).solve(0.5, 0.1, direction=["", "inflating"])
        return [*state.contraction, *state.length, *state.braid_angle]

    changes = {field: 1.01 * getattr(MUSCLE, field) for field in list_quantities(Muscle)}
    changes |= {"strands": 28, "mooney_ratio": 0.1, "friction_length": 0.01, "end_length": 3.0,
                "poisson_ratio": 0.4}  # fmt: skip
    unused = {field for field, value in changes.items()
              if answer(MUSCLE.replace(**{field: value})) == answer(MUSCLE)}  # fmt: skip
    assert unused == set(model.unused)


def test_a_batch_is_its_members(model):
    pressure, load = np.array([[0.05], [0.3], [0.8]]), np.array([0.0, 0.01, 0.02])
    contraction = model.contraction(pressure, load)
    assert contraction.shape == (3, 3)
    for i in range(3):
        for j in range(3):
            one = model.contraction(float(pressure[i, 0]), float(load[j]))
            assert one.shape == () and one == contraction[i, j]
    assert np.array_equal(
        model.force(pressure, contraction)[1, 2], model.force(0.3, contraction[1, 2])
    )
    assert model.contraction([], []).shape == model.force([], []).shape == (0,)
    assert model.stiffness([], []).shape == (0,)


def test_states_fit_together(model):
    pressure, load = np.meshgrid(np.linspace(0.02, 0.8, 7), [0.0, 0.02])
    state = model.solve(pressure, load)
    assert state.converged.all() and np.all(state.reason == "")
    assert model.force(pressure, state.contraction) == pytest.approx(load, abs=1e-11)
    assert state.force - state.residual == pytest.approx(load, abs=1e-15)
    assert state.length == pytest.approx(MUSCLE.length - state.contraction)
    active = state.length - MUSCLE.dead_length
    assert np.cos(state.braid_angle) == pytest.approx(active / model.braid.strand_length)
    assert np.all(state.contact_pressure <= pressure + 1e-15)
    assert np.array_equal(model.contraction(pressure, load), state.contraction)


def test_stiffness_is_the_slope_of_the_force(model):
    pressure, step = 0.4, 1e-4
    rest = model.contraction(pressure)
    for contraction in (0.0, -0.5, 0.5 * rest, rest):
        near = model.force(pressure, contraction + step * np.array([-1.0, 1.0]))
        slope = -np.diff(near)[0] / (2.0 * step)
        assert model.stiffness(pressure, contraction) == pytest.approx(slope, rel=1e-6)


def test_the_slope_is_taken_at_the_ends_too():
    model = build("gaylord-1")
    low, high = model.contraction_limits
    assert model.stiffness(0.5, [low, 0.0, high]) == pytest.approx(
        6.0 * 0.5 * (model.braid.length - np.array([low, 0.0, high]))
        / (4.0 * math.pi * model.braid.turns**2), rel=1e-8, abs=1e-8,
    )  # fmt: skip


def test_the_slope_of_a_quartic_is_exact_everywhere():
    toy = Toy(MUSCLE, shape=lambda e: 1.0 - e - 50.0 * (e - 0.2) ** 4)
    contraction = np.linspace(*toy.contraction_limits, 2001)  # steps from end to end
    strain = contraction / 42.0
    slope = (1.0 + 200.0 * (strain - 0.2) ** 3) / 42.0
    assert toy.stiffness(1.0, contraction) == pytest.approx(slope, rel=1e-7, abs=1e-9)


def test_a_tube_that_leaves_the_braid_has_no_contact():
    class Parting(Toy):
        card = Toy.card

        def _contact_pressure(self, pressure, length):
            return pressure - 0.5

    state = Parting(MUSCLE, shape=ramp).solve([0.4, 0.9])
    assert state.contact_pressure == pytest.approx([0.0, 0.4])
    assert state.in_contact.tolist() == [False, True]


def test_a_dead_length_only_adds_length():
    for name in OWN:
        short = build(name, MUSCLE.replace(length=42.0, dead_length=0.0))
        long = short.replace(MUSCLE)
        assert long.contraction(0.5, 0.1) == pytest.approx(short.contraction(0.5, 0.1), rel=1e-12)
        assert long.solve(0.5).length - short.solve(0.5).length == pytest.approx(3.0)


def test_the_first_root_on_the_way_is_taken():
    """A law with a hump: the muscle stops at the near side of it."""
    bumpy = Toy(MUSCLE, shape=lambda e: (0.1 - e) * (0.25 - e) * (0.4 - e))
    assert bumpy.contraction(0.5) == pytest.approx(0.1 * 42.0, rel=1e-12)
    assert bumpy.stiffness(0.5, bumpy.contraction(0.5)) > 0.0
    heavy = Toy(MUSCLE, shape=lambda e: -e - 0.01)
    assert heavy.contraction(2.0) == pytest.approx(-0.42, rel=1e-12)


def test_a_load_of_the_blocked_force_needs_no_contraction():
    toy = Toy(MUSCLE, shape=ramp)
    assert toy.contraction(0.5, 0.5) == 0.0
    assert toy.contraction(0.0, 0.0) == 0.0
    assert toy.solve(0.5, 0.5).iterations == 0


def test_a_force_that_jumps_past_the_load_is_no_solution():
    toy = Toy(MUSCLE, shape=lambda e: np.where(e < 0.123, 1.0, -1.0))
    state = toy.solve([0.5, 0.0], [0.1, 0.0])
    assert state.converged.tolist() == [False, True]
    assert state.contraction[0] == pytest.approx(0.123 * 42.0)
    assert state.reason[0] == "the force jumps past the load"
    with pytest.raises(ConvergenceError, match=r"toy model at pressure\[0\] = 0.5 MPa: the force"):
        toy.contraction([0.5, 0.0], [0.1, 0.0])


def test_a_solver_that_gives_up_says_so(monkeypatch):
    model, pressure = build("chou"), np.array([0.0, 0.6])
    good = model.solve(pressure)
    assert good.iterations[0] == 0 and 2 < good.iterations[1] < 12
    monkeypatch.setattr(roots, "MAX_ITERATIONS", 2)
    state = model.solve(pressure)
    assert state.converged.tolist() == [True, False]
    assert state.reason.tolist() == ["", "the tolerance was not met within 2 iterations"]
    assert abs(state.residual[1]) > abs(good.residual[1])
    with pytest.raises(ConvergenceError, match=r"pressure\[1\] = 0.6 MPa: the tolerance was not"):
        model.contraction(pressure)


def test_friction_has_a_sign_and_no_branch_without_direction():
    toy = Toy(MUSCLE, shape=ramp, rub=0.1, heat=1.0, extra=ramp)
    force = toy.force(1.0, 0.0, direction=["inflating", "", "deflating"])
    assert force == pytest.approx([0.9, 1.0, 1.1])
    up, free, down = toy.contraction(1.0, 0.2, direction=["inflating", "", "deflating"])
    assert up < free == toy.contraction(1.0, 0.2) < down


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"color": 3}, "^the model toy takes no 'color': it takes rub, heat, way, shape, extra$"),
        ({"rub": 6.0}, r"^rub of the model toy is 6 N: it must lie in \[0, 5\] N$"),
        ({"rub": math.nan}, "^rub of the model toy is nan N: it must lie in"),
        ({"rub": "much"}, "^rub of the model toy is 'much': it must be a number"),
        ({"rub": 1.0, "extra": ramp}, "^the model toy must be given heat: the survey has no"),
        ({"way": "third"}, r"^way of the model toy is 'third': it must be one of new, old"),
        ({"shape": 3.0}, "^shape of the model toy is 3.0: it must be a function of strain$"),
        ({"hysteresis": 3.0}, "^hysteresis is a float"),
    ],
)
def test_wrong_keywords_get_one_clear_line(given, words):
    with pytest.raises(InputError, match=words) as error:
        Toy(MUSCLE, **{"shape": ramp, **given})
    assert "\n" not in str(error.value)


def test_a_missing_law_names_its_paper():
    for keywords, law in (({}, "shape"), ({"shape": ramp, "rub": 1.0, "heat": 0.0}, "extra")):
        with pytest.raises(MissingLawError, match=rf"the law {law}\(strain\).*: it is in Nobody"):
            Toy(MUSCLE, **keywords)
    assert issubclass(MissingLawError, InputError)


def test_choices_have_a_printed_reading():
    assert Toy(MUSCLE, shape=ramp).keywords["way"] == "new"
    assert Toy(MUSCLE, shape=ramp, as_printed=True).keywords["way"] == "old"
    assert Toy(MUSCLE, shape=ramp, as_printed=True, way="new").keywords["way"] == "new"


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (lambda e: np.where(e > 0.1, np.nan, 1.0), "^answer of shape.* is nan: it must lie in"),
        (lambda e: np.ones((7, 2)), r"^answer of shape has shape \(7, 2\): it must be"),
        (lambda e: "one", "^answer of shape is 'one': it must be a number"),
    ],
)
def test_a_law_that_does_not_answer_is_refused(law, words):
    with pytest.raises(InputError, match=words):
        Toy(MUSCLE, shape=law).contraction([0.5, 0.6, 0.7], 0.1)


def test_a_law_may_write_to_its_arguments():
    def write(strain):
        strain *= -4.0
        strain += 1.0
        return strain

    toy, wrote = Toy(MUSCLE, shape=ramp), Toy(MUSCLE, shape=write)
    pressure, contraction = np.array([0.2, 0.5]), np.array([1.0, 2.0])
    assert np.array_equal(wrote.force(pressure, contraction), toy.force(pressure, contraction))
    one, two = wrote.solve(pressure, 0.1), toy.solve(pressure, 0.1)
    assert np.array_equal(one.length, two.length)
    assert contraction.tolist() == [1.0, 2.0]

    def double(length, pressure):
        length *= 2.0
        pressure *= 2.0
        return 0.0 * pressure

    plain, doubled = (
        build("doumit", hoop_stress=law) for law in (lambda length, pressure: 0.0, double)
    )
    assert plain.contraction(0.5, 0.1) == doubled.contraction(0.5, 0.1)


@pytest.mark.parametrize(
    ("law", "kind", "words"),
    [
        (lambda e: 1 / 0, ZeroDivisionError, "ZeroDivisionError: division by zero"),
        (lambda: 1.0, TypeError, "TypeError: .* 0 positional arguments but 1 was given"),
        (lambda e: {}["a\nb"], KeyError, "KeyError: "),
        (lambda e: (_ for _ in ()).throw(RuntimeError), RuntimeError, "RuntimeError"),
    ],
)
def test_a_law_that_raises_is_named(law, kind, words):
    with pytest.raises(
        InputError, match=f"^the law shape of the model toy raised {words}.*: it must take arrays "
    ) as error:
        Toy(MUSCLE, shape=law).contraction(0.5, 0.1)
    assert "\n" not in str(error.value)
    assert isinstance(error.value.__cause__, kind)


def test_an_error_of_ours_passes_through_a_law():
    def refuse(strain):
        raise MissingLawError("the rubber must be known")

    with pytest.raises(MissingLawError, match="^the rubber must be known$"):
        Toy(MUSCLE, shape=refuse).contraction(0.5, 0.1)


def test_a_law_that_raises_does_not_take_the_ranking_along():
    pressure = np.linspace(0.1, 0.8, 8)
    data = Measurements(pressure=pressure, contraction=build("chou").contraction(pressure))
    models = {"toy": partial(Toy, shape=lambda e: 1 / 0), "chou": MODELS["chou"]}
    ranking = rank(data, MUSCLE, models=models, options=RankOptions(folds=0))
    assert [entry.name for entry in ranking.models] == ["chou"]
    assert "the law shape of the model toy raised ZeroDivisionError" in ranking.refusals["toy"]


def test_a_number_will_do_for_a_law():
    assert np.array_equal(Toy(MUSCLE, shape=lambda e: 2.0).force([0.5, 1.0], 1.0), [1.0, 2.0])


def test_a_pull_that_is_not_finite_is_refused():
    class Infinite(Toy):
        card = make_card("infinite")

        def _pull(self, pressure, length):
            return pressure / (length - length)

    class Loose(Infinite):
        card = make_card("loose")

        def _pull(self, pressure, length):
            return pressure * (length - 30.0)

        def _contact_pressure(self, pressure, length):
            return np.full(pressure.shape, np.nan)

    words = "has no answer there, they must be where its law is finite$"
    with pytest.raises(InputError, match=f"the model infinite {words}"):
        Infinite(MUSCLE).force(0.5, 1.0)
    with pytest.raises(InputError, match=f"the model loose {words}"):
        Loose(MUSCLE).solve(0.5, 1.0)


@pytest.mark.parametrize(
    ("pressure", "load", "words"),
    [
        (-0.1, 0.0, r"^pressure is -0\.1 MPa: it must lie in \[0"),
        ([0.1, math.nan], 0.0, r"^pressure\[1\] is nan MPa: it must lie in \["),
        (700, 0.0, r"^pressure is 700 MPa: it must lie in \[0"),
        (0.5, [0.0, -0.2], r"^load\[1\] is -0\.2 N: it must lie in \[0, "),
        (0.5, [0.0, 1e6], r"^load\[1\] is 1e\+06 N: at a pressure of 0\.5 MPa it must lie in \["),
        ([0.1, 0.2], [0.0, 0.0, 0.0], "^these shapes do not go together: pressure"),
        ("high", 0.0, "^pressure is 'high': it must be a number"),
    ],
)
def test_wrong_arguments_get_one_clear_line(model, pressure, load, words):
    for question in (model.contraction, model.solve, model.braid_angle):
        with pytest.raises(InputError, match=words) as error:
            question(pressure, load)
        assert "\n" not in str(error.value)


def test_the_loads_that_a_message_names_can_be_held(model):
    with pytest.raises(InputError, match="must lie in") as error:
        model.contraction(0.5, 1e6)
    low, high = str(error.value).split("[")[1].split("]")[0].split(",")
    assert model.solve(0.5, [float(low), 0.9999 * float(high)]).converged.all()


def test_a_muscle_that_only_pushes_says_so():
    with pytest.raises(
        InputError, match="0 N: .* it must lie in what it pulls, and at most .*-0.1 N"
    ):
        Toy(MUSCLE, shape=lambda e: -0.2).contraction(0.5)


@pytest.mark.parametrize("contraction", [-60.0, 44.9, math.nan])
def test_wrong_contractions_get_one_clear_line(model, contraction):
    for question in (model.force, model.stiffness):
        with pytest.raises(InputError, match=rf"^contraction\[1\] is {contraction:g} mm: at a"):
            question(0.3, [0.0, contraction])


@pytest.mark.parametrize("name", OWN)
@settings(max_examples=40)
@given(data=st.data(), muscle=muscles())
def test_any_question_is_answered_or_refused(name, data, muscle):
    ask_anything(data, name, muscle, least=0.0)


def test_cards_are_checked():
    good = dict(name="k", what="k", source="fitted", bounds=(0.0, 1.0))
    for change, words in (
        ({"source": "heard"}, "source of k is 'heard'"),
        ({"bounds": (1.0, 0.0)}, "bounds of k are"),
        ({"bounds": (0.0, math.inf)}, "bounds of k are"),
        ({"default": 2.0}, r"default of k is 2: it must lie in \[0, 1\]"),
        ({"neutral": -1.0}, "neutral value of k is -1"),
    ):
        with pytest.raises(InputError, match=words):
            Parameter(**{**good, **change})
    with pytest.raises(InputError, match="a parameter, choice or law twice"):
        make_card("twice", parameters=(Parameter(**good), Parameter(**good)))
    with pytest.raises(InputError, match="has no parameter 'j'"):
        make_card("alone", parameters=(Parameter(**good, only_with="j"),))
    with pytest.raises(InputError, match="status of it is 'good'"):
        Card(name="it", title="", authors="", reference="", equation="", status="good", latex="")
    assert make_card("braid").uses == BRAID_FIELDS


def test_a_card_checks_what_is_given():
    whole = Parameter("n", "n", (1.0, 9.0), source="geometry", whole=True)
    card = make_card("k", parameters=(whole,), choices=Toy.card.choices)
    assert card.check_parameter("n", 3) == 3.0
    assert card.check_choice("way", "old") == "old"
    for question, name, value, words in (
        (card.check_parameter, "n", 2.5, r"^n of the model k is 2.5: it must be a whole number"),
        (card.check_parameter, "n", 10, r"^n of the model k is 10: it must lie in \[1, 9\]"),
        (card.check_parameter, "way", 1, "^parameter of k is 'way': it must be one of n$"),
        (card.check_choice, "way", "no", r"^way of the model k is 'no': it must be one of"),
        (card.check_choice, "n", "new", "^choice of k is 'n': it must be one of way$"),
    ):
        with pytest.raises(InputError, match=words):
            question(name, value)


def test_every_model_has_one_status():
    cards = [kind.card for kind in SURVEY.values()]
    counts = count_statuses(cards)
    assert tuple(counts) == STATUSES
    assert sum(counts.values()) == len(cards)
    assert count_statuses(iter(cards)) == counts
    assert set(count_statuses([]).values()) == {0}
