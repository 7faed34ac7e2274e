"""Search spaces: what they take, what a trial gets, and what they say of what they do not take."""

import math

import numpy as np
import optuna
import pytest
from optuna.trial import FixedTrial

from jaxslam.config.dotted import flatten
from jaxslam.config.slam import METHODS, SlamConfig
from jaxslam.study.space import VALUES_OF_A_SIZE, Parameter, Space

BASE = SlamConfig()
SIGMA = "sensor.sigma_hit"


def space_of(**tables) -> Space:
    """A space by names in which `__` stands for a dot."""
    return Space.from_tables({name.replace("__", "."): table for name, table in tables.items()}, BASE)


def only(**tables) -> Parameter:
    [parameter] = space_of(**tables).parameters
    return parameter


def values_of(parameter):
    """All that steps reach from its lower end, up to its upper one."""
    return np.arange(parameter.low, parameter.high + parameter.step / 2, parameter.step)


def tried(space, values):
    """Settings of a trial whose sampler draws these values."""
    return space.suggest(FixedTrial(values), BASE)


def test_an_interval_of_a_number_is_continuous_and_holds_its_ends():
    parameter = only(sensor__sigma_hit={"low": 0.02, "high": 0.3, "log": True})
    assert parameter == Parameter("sensor.sigma_hit", (), 0.02, 0.3, None, True, False)
    assert parameter.ends() == (0.02, 0.3)
    assert str(parameter) == "sensor.sigma_hit: 0.02 to 0.3 on a logarithmic scale"


def test_whole_ends_of_a_setting_that_is_none_are_numbers():
    parameter = only(map__margin={"low": 4, "high": 12})
    assert not parameter.whole
    assert [type(end) for end in parameter.ends()] == [float, float]


def test_an_interval_of_a_whole_setting_has_whole_values():
    parameter = only(num_particles={"low": 3, "high": 8})
    assert parameter.whole
    assert parameter.ends() == (3, 8)
    assert [type(end) for end in parameter.ends()] == [int, int]
    assert tried(Space((parameter,)), {"num_particles": 8}) == {"num_particles": 8}


@pytest.mark.parametrize(
    ("name", "table", "last", "count"),
    [
        ("map__margin", {"low": 4.0, "high": 12.0, "step": 2.0}, 12.0, 5),
        # The last value is the last that steps reach.
        ("map__margin", {"low": 4.0, "high": 12.0, "step": 3.0}, 10.0, 3),
        ("num_particles", {"low": 5, "high": 60, "step": 10}, 55, 6),
        # 0.3 - 0.1 is 0.19999999999999998, less than two steps.
        ("sensor__sigma_hit", {"low": 0.1, "high": 0.3, "step": 0.1}, 0.3, 3),
        ("sensor__sigma_hit", {"low": 0.1, "high": 1.0, "step": 0.3}, 1.0, 4),
    ],
)
def test_steps_end_on_a_step(name, table, last, count):
    parameter = only(**{name: table})
    assert parameter.high == pytest.approx(last, abs=1e-12)
    assert len(values_of(parameter)) == count
    assert f"in steps of {table['step']:g}" in str(parameter)


@pytest.mark.parametrize("table", [[0.05, 0.1, 0.2], {"choices": [0.05, 0.1, 0.2]}])
def test_choices_may_be_written_in_two_ways(table):
    parameter = only(sensor__sigma_hit=table)
    assert parameter.choices == parameter.ends() == (0.05, 0.1, 0.2)
    assert str(parameter) == "sensor.sigma_hit: 0.05, 0.1, 0.2"


def test_choices_of_true_and_false():
    space = space_of(fusion__read_poses=[True, False])
    assert tried(space, {"fusion.read_poses": False}) == {"fusion.read_poses": False}


@pytest.mark.parametrize("method", METHODS)
def test_a_method_is_chosen_first_and_gives_what_only_it_has(method):
    space = space_of(
        motion__rotation_floor={"low": 0.01, "high": 0.1},
        proposal__lost_below={"low": 0.1, "high": 0.9},
        method=list(METHODS),
    )
    assert [parameter.name for parameter in space.parts()] == ["method"]
    drawn = {"method": method, "motion.rotation_floor": 0.05, "proposal.lost_below": 0.5}
    has_it = "proposal.lost_below" in flatten(BASE.with_method(method))
    wanted = drawn if has_it else {name: drawn[name] for name in ("method", "motion.rotation_floor")}
    assert tried(space, drawn) == wanted


def test_some_methods_have_a_setting_that_others_lack():
    """Else the test before this one would hold for a space that asks for everything."""
    having = [m for m in METHODS if "proposal.lost_below" in flatten(BASE.with_method(m))]
    assert 0 < len(having) < len(METHODS)


def test_a_parameter_of_one_kind_is_asked_for_with_that_kind_only():
    space = space_of(
        proposal__kind=["motion", "fruit_fly"],
        proposal__flies__num_flies={"low": 5, "high": 20},
        sensor__kind=["beam", "likelihood_field"],
        sensor__z_unseen={"low": 0.1, "high": 0.9},
    )
    assert {parameter.name for parameter in space.parts()} == {"proposal.kind", "sensor.kind"}
    drawn = {
        "proposal.kind": "motion",
        "proposal.flies.num_flies": 7,
        "sensor.kind": "likelihood_field",
        "sensor.z_unseen": 0.3,
    }
    assert set(tried(space, drawn)) == {"proposal.kind", "sensor.kind", "sensor.z_unseen"}
    other = {**drawn, "proposal.kind": "fruit_fly", "sensor.kind": "beam"}
    assert set(tried(space, other)) == {"proposal.kind", "sensor.kind", "proposal.flies.num_flies"}


def test_where_a_parameter_applies():
    space = space_of(
        method=["rbpf", "gmapping"],
        proposal__lost_below={"low": 0.1, "high": 0.9},
        num_particles={"low": 3, "high": 8},
    )
    by_name = {parameter.name: parameter for parameter in space.parameters}
    assert space.where_it_applies(by_name["proposal.lost_below"], BASE) == {"method": "gmapping"}
    assert space.where_it_applies(by_name["num_particles"], BASE) == {"method": "rbpf"}
    assert space.where_it_applies(by_name["method"], BASE) == {}


def is_size(parameter):
    return parameter.name in ("num_particles", "map.margin", "map.resolution", "map.window")


def test_sizes_get_a_few_values_and_nothing_else_does():
    space = space_of(
        num_particles={"low": 3, "high": 100},
        map__margin={"low": 4.0, "high": 12.0},
        map__resolution=[0.05, 0.1],
        map__window={"low": 8.0, "high": 16.0, "step": 1.0},
        sensor__sigma_hit={"low": 0.02, "high": 0.3},
    ).with_steps(is_size)
    by_name = {parameter.name: parameter for parameter in space.parameters}
    assert by_name["map.margin"].step == 2.0
    assert by_name["num_particles"].step == 25
    assert by_name["num_particles"].high == 78
    assert by_name["map.window"].step == 1.0
    assert by_name["map.resolution"].choices == (0.05, 0.1)
    assert by_name["sensor.sigma_hit"].step is None
    assert len(values_of(by_name["map.margin"])) == VALUES_OF_A_SIZE
    assert list(values_of(by_name["num_particles"])) == [3, 28, 53, 78]


@pytest.mark.parametrize(
    ("low", "high", "step"), [(0.05, 0.2, None), (0.1, 1.0, 0.3), (0.0, 0.3, 0.1), (0.1, 0.7, None)]
)
def test_the_last_value_of_an_interval_is_drawn(low, high, step):
    """By Optuna, which counts in decimals: an end that is off in its last binary place would be cut away."""
    parameter = Parameter("map.resolution", (), low, high, step)
    if step is None:
        [parameter] = Space((parameter,)).with_steps(lambda _: True).parameters
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    drawn = {parameter.suggest(study.ask()) for _ in range(200)}
    assert min(drawn) == pytest.approx(low)
    assert max(drawn) == pytest.approx(high)
    assert len(drawn) == len(values_of(parameter))


@pytest.mark.parametrize("span", range(1, 12))
def test_a_size_of_few_values_has_no_more_than_it_had(span):
    parameter = Parameter("num_particles", (), 3, 3 + span, None, False, True)
    [limited] = Space((parameter,)).with_steps(lambda _: True).parameters
    values = values_of(limited)
    assert 2 <= len(values) <= min(VALUES_OF_A_SIZE, span + 1)
    assert values[-1] == limited.high <= 3 + span


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({}, r'the space is empty: give \[space\] some settings, such as "sensor.sigma_hit"'),
        (
            {"sensor.sigma_hti": [0.1]},
            "no setting is called 'sensor.sigma_hti': did you mean 'sensor.sigma_hit'",
        ),
        ({"num_particle": [3]}, "did you mean 'num_particles'"),
        ({"metod": ["rbpf"]}, "did you mean 'method'"),
        ({"sensor.kid": ["beam"]}, "did you mean 'sensor.kind'"),
        # Of none of the kinds that are chosen from.
        (
            {"proposal.kind": ["motion"], "proposal.lost_below": [0.5]},
            "no setting is called 'proposal.lost_below'",
        ),
        ({"method": ["rbpf"], "proposal.kind": ["motion"]}, "method also sets proposal.kind: give only one"),
        ({"method": ["gmaping"]}, "no method is called 'gmaping': did you mean 'gmapping'"),
        ({"proposal.kind": ["mathced"]}, "proposal is 'mathced': did you mean 'matched'"),
    ],
)
def test_a_space_that_is_none(tables, message):
    with pytest.raises(ValueError, match=message) as caught:
        Space.from_tables(tables, BASE)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "table", "message"),
    [
        (SIGMA, 0.1, "is 0.1: give a list of choices or { low"),
        (SIGMA, [], "give a list of choices without other keys"),
        (SIGMA, {"choices": 0.1}, "give a list of choices without other keys"),
        (SIGMA, {"choices": [0.1], "log": True}, "give a list of choices without other keys"),
        (SIGMA, [[0.1, 0.2], [0.3]], r"\[0.1, 0.2\] is not a choice: give numbers, text, true or false"),
        ("proposal.kind", [["motion"]], r"\['motion'\] is not a choice"),
        (SIGMA, [0.1, 0.2, 0.1], "0.1 is given twice among the choices"),
        (SIGMA, [1, 1.0], "1 is given twice"),
        (SIGMA, {"low": 0.1, "hihg": 0.2}, "has no 'hihg': there are low, high, step, log and choices"),
        ("proposal.kind", {"low": 1, "high": 2}, "is not a number: give a list of choices"),
        ("fusion.read_poses", {"low": 0, "high": 1}, "is not a number: give a list of choices"),
        ("method", {"low": 1, "high": 2}, "is not a number: give a list of choices"),
        (SIGMA, {"low": 0.1}, "give low and high"),
        (SIGMA, {"high": 0.1, "log": True}, "give low and high"),
        (SIGMA, {"low": False, "high": 0.2}, "low is False: give a finite number"),
        (SIGMA, {"low": "0.1", "high": 0.2}, "low is '0.1': give a finite number"),
        (SIGMA, {"low": 0.1, "high": math.inf}, "high is inf: give a finite number"),
        (SIGMA, {"low": math.nan, "high": 1.0}, "low is nan: give a finite number"),
        (SIGMA, {"low": 1, "high": 10**400}, "high is 10+: give a finite number"),
        (SIGMA, {"low": 0.1, "high": 0.2, "step": [1]}, r"step is \[1\]: give a finite number"),
        ("num_particles", {"low": 3.5, "high": 8}, "low is 3.5: give a whole number"),
        ("num_particles", {"low": 3, "high": 8, "step": 1.5}, "step is 1.5: give a whole number"),
        (SIGMA, {"low": 0.2, "high": 0.1}, "low is 0.2 and high is 0.1: low must be less"),
        (SIGMA, {"low": 0.2, "high": 0.2}, "low must be less"),
        (SIGMA, {"low": 0.1, "high": 0.2, "step": 0}, "step is 0: give more than 0, and no more"),
        (SIGMA, {"low": 0.1, "high": 0.2, "step": -0.1}, "step is -0.1: give more than 0"),
        (SIGMA, {"low": 0.1, "high": 0.2, "step": 0.2}, "no more than high - low"),
        (SIGMA, {"low": 0.0, "high": 0.2, "log": True}, "log needs an interval above 0 and"),
        (SIGMA, {"low": 0.1, "high": 0.9, "step": 0.1, "log": True}, "above 0 and no step"),
        (SIGMA, {"low": 0.1, "high": 0.9, "log": "yes"}, "log needs an interval above 0"),
    ],
)
def test_a_parameter_that_is_none(name, table, message):
    with pytest.raises(ValueError, match=f"space: {name}.*{message}") as caught:
        Space.from_tables({name: table}, BASE)
    assert "\n" not in str(caught.value)
