"""A study's file: what it may say, what is taken where it says nothing, and what is wrong with it."""

import dataclasses
import json
from contextlib import nullcontext

import pytest

from jaxslam.config import toml
from jaxslam.config.dotted import flatten, update
from jaxslam.config.lidar_presets import PRESETS
from jaxslam.config.slam import SlamConfig
from jaxslam.study.objectives import OBJECTIVES
from jaxslam.study.plan import Plan, Source, read_plan
from jaxslam.study.space import Parameter, Space
from tests.study.studies import LOGS, SPACE, STUDY, plan_of

EVERYTHING = """
[study]
name = "Prüfung 1"
config = "base.toml"
method = "rbpf"
seeds = [3, 5]
held_out_seeds = 2
objectives = ["heading", "time"]
sampler = "nsga-ii"
seed = 7
trials = 12
batch = 4

[filter]
num_particles = 5
sensor.z_hit = 0.9

[[logs]]
log = "drive.log"
name = "drive"
relations = "known/drive.relations"
lidar = "lds-01"

[[logs]]
log = "drive.log"
reference = "truth.tum"

[[logs]]
world = "hall_small"
duration = 20
seed = 4

[[held_out]]
world = "corridor_loop"

[space]
"sensor.sigma_hit" = { low = 0.02, high = 0.3, log = true }
map.radius = [3, 6]
[space.motion]
rotation_floor = { low = 0.01, high = 0.1, step = 0.01 }
"""


@pytest.fixture
def folder(tmp_path):
    """With the files that `EVERYTHING` names; what is in them is not looked at."""
    (tmp_path / "known").mkdir()
    for name in ("drive.log", "known/drive.relations", "truth.tum"):
        (tmp_path / name).write_text("")
    (tmp_path / "base.toml").write_text("num_particles = 9\nsensor.sigma_hit = 0.2\n")
    return tmp_path


def test_everything_that_a_plan_may_say(folder, monkeypatch):
    path = folder / "all.toml"
    path.write_text(EVERYTHING, encoding="utf-8")
    # Paths are as seen from the study's file, not from where the command is given.
    monkeypatch.chdir(folder / "known")
    drive = str(folder / "drive.log")
    assert read_plan(path) == Plan(
        name="Prüfung 1",
        base={"method": "rbpf", "num_particles": 5, "sensor.sigma_hit": 0.2, "sensor.z_hit": 0.9},
        sources=(
            Source("drive", drive, relations=str(folder / "known" / "drive.relations"), lidar="lds-01"),
            Source("drive.log", drive, reference=str(folder / "truth.tum")),
            Source("hall_small-4", world="hall_small", duration=20, seed=4),
        ),
        held_out=(Source("corridor_loop-0", world="corridor_loop"),),
        seeds=(3, 5),
        held_out_seeds=(1000, 1001),
        space=Space(
            (
                Parameter("sensor.sigma_hit", (), 0.02, 0.3, None, True),
                Parameter("map.radius", (3, 6)),
                Parameter("motion.rotation_floor", (), 0.01, 0.1, 0.01),
            )
        ),
        objectives=("heading", "time"),
        sampler="nsga-ii",
        sampler_seed=7,
        trials=12,
        batch=4,
    )


def test_what_is_taken_where_a_plan_says_nothing(tmp_path):
    plan = plan_of(tmp_path, "")
    assert plan.name == "plan"
    assert plan.base == {}
    assert plan.sources == (Source("hall_small-0", world="hall_small", duration=10, seed=0),)
    assert plan.held_out == ()
    assert (plan.seeds, plan.held_out_seeds) == ((0, 1, 2), (1000, 1001, 1002))
    assert (plan.objectives, plan.sampler, plan.trials, plan.batch) == (("error",), "tpe", 50, 1)
    # A path as text is one, too.
    assert read_plan(str(tmp_path / "plan.toml")) == plan


def test_seeds_held_out_are_others(tmp_path):
    for seeds in ("1000", "1500", "[1000, 1001, 1002]", "[7, 2000]"):
        plan = plan_of(tmp_path, f"[study]\nseeds = {seeds}\nheld_out_seeds = 1000")
        assert len(set(plan.held_out_seeds) - set(plan.seeds)) == 1000


def test_the_filter_is_of_the_method_then_the_file_then_the_table(folder):
    study = '[study]\nmethod = "fruit-fly"\nconfig = "base.toml"\n'
    plan = plan_of(folder, study, LOGS, SPACE, "[filter]\nnum_particles = 5")
    wanted = update(
        SlamConfig().with_method("fruit-fly"), {"num_particles": 5, "sensor.sigma_hit": 0.2}, exact=True
    )
    assert flatten(plan.configuration({})) == flatten(wanted)


def test_the_configuration_of_a_trial(tmp_path):
    plan = plan_of(tmp_path, STUDY, LOGS, SPACE, "[filter]\nlidar.usable_range = 2.5\nnum_particles = 5")
    tried = plan.configuration({"method": "rbpf", "sensor.sigma_hit": 0.07}, "lds-01")
    assert tried.method == "rbpf"
    assert tried.sensor.sigma_hit == 0.07
    assert tried.num_particles == 5
    # The lidar of the log, but for what the plan says of it.
    assert tried.lidar.max_range == PRESETS["lds-01"].max_range
    assert tried.lidar.usable_range == 2.5
    with pytest.raises(ValueError, match=r"sigma_hit is -1\.0"):
        plan.configuration({"sensor.sigma_hit": -1.0})


def test_a_part_that_the_space_chooses_may_have_settings_in_it(tmp_path):
    space = '[space]\nmethod = ["rbpf", "gmapping"]\n"proposal.lost_below" = { low = 0.1, high = 0.9 }'
    plan = plan_of(tmp_path, STUDY, LOGS, space)
    assert [parameter.name for parameter in plan.space.parameters] == ["method", "proposal.lost_below"]


def test_what_describes_a_plan_is_json_and_says_what_makes_trials_comparable(tmp_path):
    plan = plan_of(tmp_path)
    described = plan.described()
    assert json.loads(json.dumps(described)) == described
    alike = {"trials": 9, "batch": 3, "sampler": "random", "sampler_seed": 4, "held_out_seeds": (5,)}
    for name, value in alike.items():
        assert dataclasses.replace(plan, **{name: value}).described() == described, name
    others = {
        "seeds": (0,),
        "objectives": ("heading",),
        "base": {"num_particles": 4},
        "sources": (dataclasses.replace(plan.sources[0], seed=3),),
        "space": Space(plan.space.parameters[:1]),
    }
    for name, value in others.items():
        assert dataclasses.replace(plan, **{name: value}).described() != described, name


def world(text):
    return f'[[logs]]\nworld = "hall_small"\n{text}\n'


def log(text):
    return f'[[logs]]\nlog = "drive.log"\n{text}\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        # Names.
        (f"[spaec]\n{LOGS}{SPACE}", "a study has no table 'spaec': did you mean 'space'"),
        (f"trials = 3\n{LOGS}{SPACE}", "a study has no table 'trials'"),
        (f"[study]\ntrails = 3\n{LOGS}{SPACE}", r"\[study\] has no 'trails': did you mean 'trials'"),
        (world("durration = 3") + SPACE, r"\[\[logs\]\] 1 has no 'durration': did you mean 'duration'"),
        (f'[study]\nobjectives = ["eror"]\n{LOGS}{SPACE}', "objectives is 'eror': did you mean 'error'"),
        (f'[study]\nsampler = "tpee"\n{LOGS}{SPACE}', "sampler is 'tpee': did you mean 'tpe'"),
        (f'[study]\nmethod = "gmaping"\n{LOGS}{SPACE}', "'gmaping': did you mean 'gmapping'"),
        (f'[[logs]]\nworld = "hal_small"\n{SPACE}', "world is 'hal_small': did you mean 'hall_small'"),
        (world('lidar = "sik"') + SPACE, "lidar is 'sik': did you mean 'sick'"),
        (f"[filter]\nsensor.sigma_hti = 1.0\n{LOGS}{SPACE}", "did you mean 'sensor.sigma_hit'"),
        (f'{LOGS}[space]\n"sensor.σ_hit" = [0.1]', "'sensor.σ_hit': did you mean 'sensor.z_hit'"),
        # Tables that are none.
        (f"space = 3\n{LOGS}", r"space is 3: write a table, \[space\]"),
        (f"[[study]]\n{LOGS}{SPACE}", r"study is \[\{\}\]: write a table"),
        (f"filter = [1]\n{LOGS}{SPACE}", r"filter is \[1\]: write a table"),
        (f'[logs]\nworld = "hall_small"\n{SPACE}', r"logs is one table: write \[\[logs\]\] with two"),
        (f'logs = ["hall_small"]\n{SPACE}', "'hall_small' stands where a table is wanted"),
        # What is said of a study.
        (f"[study]\nname = 3\n{LOGS}{SPACE}", "name is 3: give text that can be the name of a file"),
        (f'[study]\nname = ""\n{LOGS}{SPACE}', "name is '': give text"),
        (f'[study]\nname = ".."\n{LOGS}{SPACE}', r"name is '\.\.': give text"),
        (f'[study]\nname = "../x"\n{LOGS}{SPACE}', "name is '../x': give text"),
        (f'[study]\nname = "a\\nb"\n{LOGS}{SPACE}', r"name is 'a\\nb': give text"),
        (f"[study]\ntrials = 0\n{LOGS}{SPACE}", "trials is 0: give a whole number, 1 or more"),
        (f"[study]\ntrials = true\n{LOGS}{SPACE}", "trials is True: give a whole number"),
        (f"[study]\ntrials = 4.0\n{LOGS}{SPACE}", "trials is 4.0: give a whole number"),
        (f"[study]\nbatch = 0\n{LOGS}{SPACE}", "batch is 0: give a whole number, 1 or more"),
        (f"[study]\nseed = -1\n{LOGS}{SPACE}", "seed is -1: give a whole number, 0 or more"),
        (f"[study]\nseeds = 0\n{LOGS}{SPACE}", "seeds is 0: give a number, 1 to 10000, or a list"),
        (f"[study]\nseeds = 99999999999\n{LOGS}{SPACE}", "seeds is 99999999999: give a number"),
        (f"[study]\nseeds = true\n{LOGS}{SPACE}", "seeds is True: give a number"),
        (f"[study]\nseeds = []\n{LOGS}{SPACE}", r"seeds is \[\]: give a number"),
        (f"[study]\nseeds = [-1]\n{LOGS}{SPACE}", r"seeds is \[-1\]: .* 0 to 4294967295"),
        # `jax.random.key` would take its last 32 bits, which are those of 0.
        (f"[study]\nseeds = [0, 4294967296]\n{LOGS}{SPACE}", "seeds is .* 0 to 4294967295"),
        (f"[study]\nseeds = [1, 1]\n{LOGS}{SPACE}", "give each seed once"),
        (f"[study]\nheld_out_seeds = [9, 2]\n{LOGS}{SPACE}", "held_out_seeds has 2, which are tuning seeds"),
        (f'[study]\nheld_out_seeds = "a"\n{LOGS}{SPACE}', "held_out_seeds is 'a': give a number"),
        (f'[study]\nobjectives = "error"\n{LOGS}{SPACE}', "objectives is 'error': give a list with some of"),
        (f"[study]\nobjectives = []\n{LOGS}{SPACE}", r"objectives is \[\]: give a list"),
        (f'[study]\nobjectives = ["error", "error"]\n{LOGS}{SPACE}', "objectives names one twice: error"),
        (
            f'[study]\nsampler = "cma-es"\nobjectives = ["error", "time"]\n{LOGS}{SPACE}',
            "cma-es, which takes one objective: use nsga-ii or tpe",
        ),
        (f"[study]\nconfig = 3\n{LOGS}{SPACE}", "config is 3: give a path as text"),
        (f'[study]\nconfig = "no.toml"\n{LOGS}{SPACE}', "config: .*no.toml does not exist"),
        # Logs and worlds.
        (f"{STUDY}{SPACE}", r"no \[\[logs\]\]: give one or more to tune on"),
        (f"logs = []\n{SPACE}", r"no \[\[logs\]\]"),
        (world('log = "drive.log"') + SPACE, r"\[\[logs\]\] 1: give a log or a world"),
        (f"[[logs]]\nduration = 3\n{SPACE}", r"\[\[logs\]\] 1: give a log or a world"),
        (LOGS + '[[held_out]]\nlog = "no.log"\n' + SPACE, r"\[\[held_out\]\] 1 log: .*no.log does not exist"),
        (log('reference = "no.tum"') + SPACE, "reference: .*no.tum does not exist"),
        (log("relations = 3") + SPACE, "relations is 3: give a path as text"),
        (world('reference = "truth.tum"') + SPACE, "reference is for a log; of a world the truth is known"),
        (log('reference = "truth.tum"\nduration = -5') + SPACE, "duration is -5: give seconds, more than 0"),
        (log('reference = "truth.tum"\nseed = 5') + SPACE, "seed is for a world"),
        (log('reference = "truth.tum"\nrelations = "truth.tum"') + SPACE, "give relations or a reference"),
        (world("name = 3") + SPACE, "name is 3: give text"),
        (world("duration = 0") + SPACE, "duration is 0: give seconds, more than 0, at most 86400"),
        (world("duration = true") + SPACE, "duration is True: give seconds"),
        (world("duration = nan") + SPACE, "duration is nan: give seconds"),
        (world("duration = 1e300") + SPACE, r"duration is 1e\+300: give seconds"),
        (world(f"duration = 1{'0' * 400}") + SPACE, "duration is 10+: give seconds"),
        (world("seed = -1") + SPACE, "seed is -1: give 0 to 4294967295"),
        # What an objective needs.
        (log("") + SPACE, "drive.log: give relations or a reference, to measure the error against"),
        (LOGS + '[[held_out]]\nlog = "drive.log"\n' + SPACE, "drive.log: give relations or a reference"),
        (
            '[study]\nobjectives = ["map"]\n' + log('reference = "truth.tum"') + SPACE,
            "drive.log: the objective map is for worlds: a log has no true map",
        ),
        # The space, with both ends of every interval tried.
        (LOGS, r"the space is empty: give \[space\] some settings"),
        (f"{LOGS}[space.sensor]", "the space is empty"),
        (f"{LOGS}[space]\nnum_particles = {{ low = 0, high = 9 }}", "num_particles = 0: .* give 1 or more"),
        (f"{LOGS}[space]\nmap.radius = {{ low = 3, high = 99 }}", "map.radius = 99: .*give 1 to"),
        (f'{LOGS}[space]\n"sensor.sigma_hit" = [0.1, -0.1]', "sensor.sigma_hit = -0.1: .* must be > 0"),
        (f'{LOGS}[space]\n"sensor.sigma_hit" = ["a"]', "sensor.sigma_hit = 'a': .*give a number"),
        (f'{LOGS}[space]\n"fusion.use" = ["off", "no"]', "fusion.use = 'no': "),
        (
            f'{LOGS}[space]\nmethod = ["rbpf", "gmapping"]\n"proposal.min_valid_beams" = [-1.0, 5.0]',
            "proposal.min_valid_beams = -1.0: ",
        ),
        # No TOML.
        ("[study", "not valid TOML: "),
        ("a = 1\na = 2", "not valid TOML: "),
    ],
)
def test_a_plan_that_is_none(folder, text, message):
    path = folder / "bad.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=message) as caught:
        read_plan(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_files_that_are_no_plan(tmp_path):
    (tmp_path / "binary.toml").write_bytes(b"\x93NUMPY\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"binary\.toml: not a text file: give a study in TOML"):
        read_plan(tmp_path / "binary.toml")
    with pytest.raises(ValueError, match=r"missing\.toml: no such file: check the path, or give a study in"):
        read_plan(tmp_path / "missing.toml")
    with pytest.raises(IsADirectoryError):
        read_plan(tmp_path)


@pytest.mark.parametrize("objective", OBJECTIVES)
def test_what_an_objective_asks_of_a_source(objective):
    a_world = Source("world", world="hall_small")
    a_log = Source("log", log="drive.log")
    by_relations = dataclasses.replace(a_log, relations="known")
    # A world has all that any asks for.
    refused = {"time": [], "map": [a_log, by_relations]}.get(objective, [a_log])
    for source in (a_world, a_log, by_relations):
        with pytest.raises(ValueError, match=r"^log: ") if source in refused else nullcontext():
            OBJECTIVES[objective].check(source)


def test_a_plan_is_a_file_of_its_own(folder):
    """What `jaxslam config` prints is no study, and is told so."""
    path = folder / "config.toml"
    toml.save(path, SlamConfig())
    with pytest.raises(ValueError, match="a study has no table 'num_particles'"):
        read_plan(path)
