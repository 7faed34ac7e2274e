"""Configurations: round trips, names, values, presets, and the filter that is built."""

import dataclasses
import math
import sys
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxslam.config import toml
from jaxslam.config.dotted import descriptions, flatten, parse_assignment, update
from jaxslam.config.lidar import LidarSettings
from jaxslam.config.lidar_presets import PRESETS, detect_lidar, lidar_preset
from jaxslam.config.localization import LocalizationConfig
from jaxslam.config.registry import VARIANTS
from jaxslam.config.slam import METHODS, SlamConfig
from jaxslam.config.thinning import Thinning
from jaxslam.io import LogError, read_log
from jaxslam.io.log import ScanTrack, SensorLog
from jaxslam.pipeline.build import build_slam
from jaxslam.preprocess.ranges import correct_scans
from jaxslam.proposal.motion import MotionProposal
from jaxslam.resampling import ResidualResampler

BOUNDS = np.array([[-1.0, -2.0], [9.0, 3.0]])


def equal(one: SlamConfig, other: SlamConfig) -> bool:
    same_structure = jax.tree.structure(one) == jax.tree.structure(other)
    return same_structure and jax.tree.leaves(one) == jax.tree.leaves(other)


def unusual() -> SlamConfig:
    """Every scalar changed to a value that no default has, and other choices made."""
    kinds = {
        "motion": "velocity",
        "resampling.scheme": "residual",
        "lidar.name": 'a "b" \\ ü',
        "fusion.use": "on",
        "fusion.yaw_axis": "-y",
        "fusion.ekf.frame": "world",
    }
    configuration = update(SlamConfig(), kinds)
    changes: dict[str, object] = {}
    for index, (name, value) in enumerate(flatten(configuration).items()):
        if isinstance(value, bool):
            changes[name] = not value
        elif isinstance(value, float):
            changes[name] = value * (1 + (index + 1) * 1e-9) - 1e-17
        elif isinstance(value, int):
            changes[name] = value + 2
    return update(configuration, changes, exact=True)


@pytest.mark.parametrize("make", [SlamConfig, unusual])
def test_saved_and_loaded_is_the_same_pytree(make, tmp_path):
    configuration = make()
    toml.save(tmp_path / "c.toml", configuration)
    assert equal(toml.load(tmp_path / "c.toml"), configuration)
    assert toml.dumps(toml.load(tmp_path / "c.toml")) == toml.dumps(configuration)


def test_unusual_differs_everywhere():
    default, changed = flatten(SlamConfig()), flatten(unusual())
    same = {name for name in default.keys() & changed.keys() if default[name] == changed[name]}
    assert same <= {"sensor.kind", "proposal.kind"}


PLACES = {
    SlamConfig: ("motion", "sensor", "proposal", "resampling.scheme"),
    LocalizationConfig: ("sensor",),
}


@pytest.mark.parametrize(("base", "name"), [(base, name) for base in VARIANTS for name in VARIANTS[base]])
def test_every_variant_round_trips(base, name, tmp_path):
    whole, place = next(
        (whole, place)
        for whole, places in PLACES.items()
        for place in places
        if isinstance(_part(whole(), place), base)
    )
    configuration = update(whole(), {place: name})
    assert type(_part(configuration, place)) is VARIANTS[base][name]
    toml.save(tmp_path / "c.toml", configuration)
    read = toml.apply(tmp_path / "c.toml", toml.read_settings(tmp_path / "c.toml"), whole())
    assert equal(read, configuration)


def _part(configuration: object, place: str) -> object:
    part: object = configuration
    for name in place.split("."):
        part = getattr(part, name)
    return part


def test_floats_are_leaves_and_sizes_are_not():
    configuration = SlamConfig()
    leaves = jax.tree.leaves(configuration)
    assert all(isinstance(leaf, float) for leaf in leaves)
    traced = [
        name
        for name, value in flatten(configuration).items()
        if isinstance(value, float) and not name.startswith("thinning.")
    ]
    assert len(leaves) == len(traced)


def test_every_setting_is_explained():
    missing = [name for name, text in descriptions(SlamConfig()).items() if not text]
    assert missing == []


def test_toml_carries_the_units():
    lines = toml.dumps(SlamConfig().with_lidar("sick")).splitlines()
    assert "meters" in lines[lines.index("usable_range = 16.0") - 1]


@pytest.mark.parametrize("name", ["sensor.sigma_hit", "sigma_hit"])
def test_short_names_will_do(name):
    assert update(SlamConfig(), {name: 0.25}).sensor.sigma_hit == 0.25


def test_whole_numbers_become_floats_where_floats_are_kept():
    value = update(SlamConfig(), {"sigma_hit": 1}).sensor.sigma_hit
    assert isinstance(value, float)
    assert value == 1.0


def test_a_choice_and_its_fields_in_one_go():
    configuration = update(
        SlamConfig(), {"covariance_scale": 2.0, "motion": "gaussian", "resampling.scheme.kind": "residual"}
    )
    assert configuration.motion.covariance_scale == 2.0
    assert type(configuration.resampling.scheme) is ResidualResampler


def test_choosing_what_is_there_keeps_its_values():
    configuration = update(SlamConfig(), {"lost_below": 0.75})
    assert configuration.with_method("gmapping").proposal.lost_below == 0.75


@pytest.mark.parametrize("config", [SlamConfig(), LocalizationConfig()], ids=lambda c: type(c).__name__)
def test_settings_change_by_name_on_the_configuration_itself(config):
    changed = config.with_settings({"sensor.sigma_hit": 0.15, "motion": "velocity"})
    assert changed.sensor.sigma_hit == 0.15
    assert type(changed.motion).__name__ == "VelocityMotion"
    assert config.sensor.sigma_hit != 0.15
    with pytest.raises(ValueError, match=r"did you mean 'sensor\.sigma_hit'"):
        config.with_settings({"sensor.sigma_hitt": 0.1})


OWN = """
import equinox as eqx
from jaxslam.proposal import MotionProposal
from jaxslam.proposal.base import AbstractProposal

class Metropolis(AbstractProposal):
    step: float = 0.1
    num_moves: int = eqx.field(static=True, default=8)

    def sample(self, key, pose, context):
        return MotionProposal().sample(key, pose, context)
"""


def test_a_class_of_the_current_folder_is_chosen_saved_and_read_back(tmp_path, monkeypatch):
    (tmp_path / "own_proposal.py").write_text(OWN)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    monkeypatch.delitem(sys.modules, "own_proposal", raising=False)
    changes = {"proposal": "own_proposal:Metropolis", "num_moves": 5}
    configuration = SlamConfig().with_settings(changes)
    assert (type(configuration.proposal).__name__, configuration.proposal.num_moves) == ("Metropolis", 5)
    assert configuration.method == "Metropolis"
    toml.save("c.toml", configuration)
    assert 'kind = "own_proposal:Metropolis"' in Path("c.toml").read_text()
    assert equal(toml.load("c.toml"), configuration)
    # A class that is chosen already keeps its settings; the object itself can be given as well.
    given = SlamConfig(proposal=type(configuration.proposal)(step=0.3))
    assert update(given, {"proposal": "own_proposal:Metropolis"}).proposal.step == 0.3
    assert flatten(given)["proposal.kind"] == "own_proposal:Metropolis"


def test_methods():
    assert SlamConfig().method == "gmapping"
    assert {SlamConfig().with_method(method).method for method in METHODS} == set(METHODS)
    assert type(SlamConfig().with_method("rbpf").proposal) is MotionProposal


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"sensor.sigma_hitt": 1.0},
            "no setting is called 'sensor.sigma_hitt': did you mean 'sensor.sigma_hit'",
        ),
        ({"num_partcles": 5}, "did you mean 'num_particles'"),
        ({"marign": 5.0}, "did you mean 'map.margin'"),
        (
            {"sigma_cells": 1.0},
            "could be proposal.heading.sigma_cells, proposal.*, proposal.search.sigma_cells",
        ),
        ({"sigma_hit": 1.0, "sensor.sigma_hit": 2.0}, "sensor.sigma_hit is given twice"),
        ({"num_particles": 0}, "num_particles is 0: give 1 or more"),
        ({"num_particles": -3}, "num_particles is -3: give 1 or more"),
        ({"num_particles": 2.5}, "num_particles is 2.5: give a whole number"),
        ({"num_particles": True}, "num_particles is True: give a whole number"),
        ({"sigma_hit": math.nan}, "sensor.sigma_hit is nan: give a finite number"),
        ({"sigma_hit": math.inf}, "sensor.sigma_hit is inf: give a finite number"),
        ({"sigma_hit": "wide"}, "sensor.sigma_hit is 'wide': give a number"),
        ({"sigma_hit": [1.0]}, r"sensor.sigma_hit is \[1.0\]: give a number"),
        ({"proposal": "matcht"}, "proposal is 'matcht': did you mean 'matched'? There are motion, matched"),
        (
            {"proposal": "gone:Own"},
            "proposal is 'gone:Own': No module named 'gone': give a class in a module of",
        ),
        (
            {"proposal": "math:Own"},
            "proposal is 'math:Own': module 'math' has no attribute 'Own': give a class",
        ),
        ({"proposal": ":Own"}, "proposal is ':Own': Empty module name"),
        ({"proposal": "math:pi"}, "proposal is 'math:pi': pi is not a subclass of AbstractProposal"),
        ({"proposal": "jaxslam.sensor:Beam"}, "Beam is not a subclass of AbstractProposal: derive it"),
        ({"motion": "jaxslam.motion:AbstractMotionModel"}, "Can't instantiate .* give every field a default"),
        ({"proposal": "motion", "lost_below": 1.0}, "no setting is called 'lost_below'"),
        ({"usable_range": 0.0}, "lidar.usable_range is 0.0: give a number of meters above 0"),
        (
            {"min_range": 100.0},
            "lidar.min_range is 100.0 m and lidar.max_range 80.0 m: give a min_range below max_range",
        ),
        ({"resolution": -0.05}, "map.resolution is -0.05"),
        ({"margin": -1.0}, "map.margin is -1.0: give a number of meters, 0 or more"),
        ({"map.radius": 16}, "map.radius is 16: give 1 to 10 cells"),
        ({"min_translation": -0.1}, "thinning.min_translation is -0.1: give 0 or more"),
        ({"threshold": -0.5}, "threshold is -0.5, must be >= 0"),
    ],
)
def test_bad_values_get_one_line(changes, message):
    with pytest.raises(ValueError, match=message.replace("?", r"\?")) as caught:
        update(SlamConfig(), changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("num_particles = \n", "not valid TOML: .*line 1"),
        ("num_particls = 3", "no setting is called 'num_particls': did you mean 'num_particles'"),
        ("sigma_hit = 0.1", "no setting is called 'sigma_hit': did you mean 'sensor.sigma_hit'"),
        ('[sensor]\nsigma_hit = "0.1"', "sensor.sigma_hit is '0.1': give a number"),
        ("[num_particles]\nx = 1", "no setting is called 'num_particles.x'"),
        ("lidar = 3", "no setting is called 'lidar'"),
        ("[proposal]\nkind = 4", "proposal is 4: There are motion"),
        ("[map]\nmargin = nan", "map.margin is nan"),
        (b"\xff\xfe", "not a text file"),
    ],
)
def test_bad_toml_gets_one_line_with_the_file(content, message, tmp_path):
    path = tmp_path / "c.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ValueError, match=message) as caught:
        toml.load(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_toml_may_name_a_few_settings_in_any_order(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(
        "[motion]\ncovariance_scale = 3\nkind = 'gaussian'\n[map]\nmargin = 2\n", encoding="utf-8"
    )
    loaded = toml.load(path, dataclasses.replace(SlamConfig(), num_particles=7))
    assert loaded.motion.covariance_scale == 3.0
    assert (loaded.map.margin, loaded.num_particles) == (2.0, 7)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("num_particles=50", ("num_particles", 50)),
        ("margin = -1.5", ("margin", -1.5)),
        ("x=1e-3", ("x", 1e-3)),
        ("proposal=motion", ("proposal", "motion")),
        ("x=true", ("x", True)),
        ("lidar.name=a=b", ("lidar.name", "a=b")),
    ],
)
def test_assignments(text, expected):
    name, value = parse_assignment(text)
    assert (name, value) == expected
    assert type(value) is type(expected[1])


@pytest.mark.parametrize("text", ["sigma_hit", "=3", "sigma_hit=", ""])
def test_bad_assignments(text):
    with pytest.raises(ValueError, match="is not name=value"):
        parse_assignment(text)


def test_build_sizes_map_and_window():
    """10 × 5 m of path, 8 m of reach, 12 m of margin and 0.3 × 10 m around: 56 × 51 m."""
    slam = build_slam(update(SlamConfig().with_lidar("sick"), {"usable_range": 8.0}), BOUNDS)
    assert (slam.grid.height, slam.grid.width) == (1020, 1120)
    np.testing.assert_allclose(slam.grid.origin, [-24.0, -25.0])
    # 160 cells of reach, 6 of truncation and one more on both sides: 334, and on to a multiple of 4.
    assert slam.window_size == 336
    assert slam.radius == 6
    # A lidar that sees farther has the window ahead of it, and the map around it grows alone.
    far = build_slam(update(SlamConfig().with_lidar("sick"), {"usable_range": 16.0}), BOUNDS)
    assert far.window_size == 336
    assert (far.grid.height, far.grid.width) == (1340, 1440)


def test_a_map_without_margin_still_holds_the_window():
    slam = build_slam(update(SlamConfig().with_lidar("sick"), {"margin": 0}), np.zeros((2, 2)))
    assert slam.grid.width >= slam.window_size
    assert slam.grid.height >= slam.window_size + 2 * (slam.radius + 1)


def test_build_takes_everything_from_the_configuration():
    configuration = unusual()
    slam = build_slam(configuration, BOUNDS)
    for name in ("motion", "sensor", "proposal", "resampling", "occupancy", "num_particles"):
        assert getattr(slam, name) == getattr(configuration, name), name
    assert slam.usable_range == configuration.lidar.usable_range
    assert slam.window_size % 4 == 0


def test_maps_that_cannot_fit_are_refused():
    with pytest.raises(ValueError, match=r"lower num_particles or map\.margin"):
        build_slam(update(SlamConfig().with_lidar("sick"), {"margin": 1e6}), BOUNDS)


def _log(num_beams: int, field_of_view: float, range_max: float, rate: float) -> SensorLog:
    count = 5
    scans = ScanTrack(
        stamps=np.arange(count) / rate,
        ranges=np.tile(np.linspace(0.01, range_max, num_beams, dtype=np.float32), (count, 1)),
        num_beams=np.full(count, num_beams),
        angle_min=np.zeros(count),
        angle_increment=np.full(count, np.deg2rad(field_of_view) / (num_beams - 1)),
        range_min=0.0,
        range_max=range_max,
        pose_base_lidar=np.zeros(3),
        mounting_known=True,
        topic="scan",
    )
    return SensorLog(path=Path("a.log"), scans=scans)


@pytest.mark.parametrize(
    ("num_beams", "field_of_view", "range_max", "rate", "name"),
    [
        (181, 180, 8.18, 1.0, "sick"),
        (361, 180, 81.8, 37.5, "sick"),
        (180, 179, 50.0, 0.5, "sick"),
        (682, 240, 5.6, 10.0, "urg-04lx"),
        (682, 240, 4.0, 10.0, "urg-04lx"),
        (360, 359, 6.0, 5.5, "rplidar-a1"),
        (360, 359, 12.0, 7.0, "rplidar-a1"),
        (360, 359, 3.5, 5.0, "lds-01"),
        (260, 357.7, 100.0, 9.1, "lds-02"),
        (240, 351, 8.0, 9.0, "lds-02"),
        (1081, 270, 30.0, 40.0, "generic"),
        (2000, 359.8, 100.0, 20.0, "generic"),
    ],
)
def test_lidar_is_detected(num_beams, field_of_view, range_max, rate, name):
    preset = detect_lidar(_log(num_beams, field_of_view, range_max, rate))
    assert preset.name == name
    LidarSettings.from_preset(preset)


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("carmen/intel.clf.gz", "sick"),
        ("carmen/mines_exp1.clf.gz", "urg-04lx"),
        ("bags/turtlebot3_drive.mcap", "lds-02"),
    ],
)
def test_lidars_of_real_logs(file, name, data_dir):
    assert detect_lidar(read_log(data_dir / file)).name == name


def test_no_scans_no_lidar():
    with pytest.raises(LogError, match="no laser scans"):
        detect_lidar(SensorLog(path=_log(10, 180, 8.0, 1.0).path))


def test_unknown_preset_names_the_nearest():
    with pytest.raises(ValueError, match="did you mean 'lds-02'"):
        lidar_preset("LDS02")


@pytest.mark.parametrize("preset", PRESETS.values(), ids=lambda preset: preset.name)
def test_presets_are_consistent(preset):
    assert preset.min_range < preset.usable_range <= preset.max_range
    assert SlamConfig().with_lidar(preset).lidar.name == preset.name


def test_readings_outside_of_the_interval_are_no_return():
    log = _log(4, 180, 9.0, 1.0)  # readings 0.01, 3.0067, 6.0033, 9 m
    lidar = LidarSettings("x", 3.5, 0.05, 6.0)
    assert log.scans is not None
    kept = correct_scans(log, lidar)[0].scans
    assert kept is not None
    np.testing.assert_array_equal(np.isfinite(kept.ranges[0]), [False, True, False, False])
    assert np.isfinite(log.scans.ranges).all()


def test_thinning_is_static():
    structure = jax.tree.structure(SlamConfig())
    changed = dataclasses.replace(SlamConfig(), thinning=Thinning(0.5, 0.5))
    assert jax.tree.structure(changed) != structure


@pytest.mark.parametrize(
    "assignment",
    [
        "sensor.sigma_hit=-1",
        "sensor.z_hit=-1",
        "occupancy.hit=-2",
        "occupancy.miss=3",
        "occupancy.limit=50",
        "proposal.search.num_rotations=12",
        "proposal.fine.sigma_cells=0",
        "proposal.prior_weight=-1",
    ],
)
def test_values_that_make_no_sense_are_refused(assignment):
    name, value = parse_assignment(assignment)
    with pytest.raises(ValueError, match=name.rpartition(".")[2]):
        update(SlamConfig(), {name: value})
