"""What a study found, told of studies whose trials are made up."""

import dataclasses
import json

import numpy as np
import optuna
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution
from PIL import Image

from jaxslam.config import toml
from jaxslam.config.dotted import flatten, update
from jaxslam.config.slam import SlamConfig
from jaxslam.study import report as module
from jaxslam.study.report import (
    FEWEST,
    counts,
    draw_parallel,
    importance_table,
    summarize,
    trial_table,
    write_report,
)
from jaxslam.viz import style
from tests.study.studies import LOGS, STUDY, plan_of, store_of

SPACE = """[space]
"sensor.sigma_hit" = { low = 0.02, high = 0.5, log = true }
num_particles = { low = 5, high = 40 }
method = ["rbpf", "gmapping"]
"proposal.lost_below" = { low = 0.1, high = 0.9 }
"""
DISTRIBUTIONS = {
    "sensor.sigma_hit": FloatDistribution(0.02, 0.5, log=True),
    "num_particles": IntDistribution(5, 40),
    "method": CategoricalDistribution(["rbpf", "gmapping"]),
    "proposal.lost_below": FloatDistribution(0.1, 0.9),
}
PICTURES = {"history.png", "parallel.png", "importance.png"}


def add(store, values, **settings):
    """A trial of these settings with these values, or of a failure."""
    settings = {name.replace("__", "."): value for name, value in settings.items()}
    failed = isinstance(values, str)
    store.study.add_trial(
        optuna.trial.create_trial(
            state=optuna.trial.TrialState.FAIL if failed else optuna.trial.TrialState.COMPLETE,
            values=None if failed else values,
            params=settings,
            distributions={name: DISTRIBUTIONS[name] for name in settings},
            user_attrs={"failure": values} if failed else {},
        )
    )


@pytest.fixture
def made_up(tmp_path):
    """A study by its objectives: 30 trials whose first value hangs on sigma_hit, the second on particles."""

    def make(*objectives, count=30, name="try", failures=True):
        plan = dataclasses.replace(plan_of(tmp_path, STUDY, LOGS, SPACE), name=name, objectives=objectives)
        store = store_of(plan, tmp_path)
        rng = np.random.default_rng(0)
        for _ in range(count):
            sigma = float(np.exp(rng.uniform(np.log(0.02), np.log(0.5))))
            particles = int(rng.integers(5, 41))
            method = str(rng.choice(["rbpf", "gmapping"]))
            # Least at 0.1; the fewer the faster; and no rank hangs on the method.
            values = [0.1 + np.log(sigma / 0.1) ** 2 + 0.05 / particles, 0.3 * particles, 1.0][
                : len(objectives)
            ]
            more = {"proposal__lost_below": float(rng.uniform(0.1, 0.9))} if method == "gmapping" else {}
            add(store, values, sensor__sigma_hit=sigma, num_particles=particles, method=method, **more)
        if failures:
            for number in range(3):
                reason = "the robot left the map" if number < 2 else "a trajectory is not finite"
                add(store, reason, sensor__sigma_hit=0.4, num_particles=5, method="rbpf")
            store.ask(1)
        return store, plan

    return make


def rows_of(table):
    """The cells of a Markdown table, the header first."""
    header, rule, *rows = table.splitlines()
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in (header, *rows)]
    assert rule == "|" + "---|" * len(cells[0])
    assert {len(row) for row in cells} == {len(cells[0])}
    return cells


def test_the_table_has_the_best_trial_first(made_up):
    store, plan = made_up("error")
    summary = summarize(store, plan.objectives)
    header, *rows = rows_of(trial_table(summary))
    assert header == [
        "trial",
        "error, m",
        "sensor.sigma_hit",
        "num_particles",
        "method",
        "proposal.lost_below",
    ]
    assert len(rows) == 30
    errors = [float(row[1]) for row in rows]
    assert errors == sorted(errors)
    # What a method does not have is empty.
    assert all((row[5] == "") == (row[4] == "rbpf") for row in rows)
    assert [row[0].endswith("*") for row in rows] == [True, *[False] * 29]
    assert int(rows[0][0].removesuffix(" *")) == summary.best.number
    assert rows_of(trial_table(summary, 4))[1:] == rows[:4]


def test_trials_of_the_front_have_a_star(made_up):
    store, plan = made_up("error", "time")
    summary = summarize(store, plan.objectives)
    values = np.array([trial.values for trial in summary.complete])
    better = (values[None] <= values[:, None]).all(-1) & (values[None] < values[:, None]).any(-1)
    wanted = {
        trial.number for trial, beaten in zip(summary.complete, better.any(1), strict=True) if not beaten
    }
    _, *rows = rows_of(trial_table(summary))
    assert {int(row[0].removesuffix(" *")) for row in rows if row[0].endswith("*")} == wanted
    assert 1 < len(wanted) < len(rows)
    assert {trial.number for trial in summary.front} == wanted
    assert [trial.values[0] for trial in summary.front] == sorted(trial.values[0] for trial in summary.front)


def test_importances_are_shares_and_the_largest_is_what_made_the_values(made_up):
    store, plan = made_up("error", "time")
    summary = summarize(store, plan.objectives)
    for objective, largest in (("error", "sensor.sigma_hit"), ("time", "num_particles")):
        shares = summary.importances[objective]
        assert sum(shares.values()) == pytest.approx(1.0)
        assert max(shares, key=shares.get) == largest
        assert shares[largest] > 0.8
        # A trial may not have it: it has no share.
        assert "proposal.lost_below" not in shares
    header, *rows = rows_of(importance_table(summary))
    assert header[0] == "importance for"
    assert [row[0] for row in rows] == ["error, m", "time, ms per scan"]
    for row in rows:
        assert sum(map(float, row[1:])) == pytest.approx(1.0, abs=0.011)


@pytest.mark.parametrize("count", [1, FEWEST - 1])
def test_of_few_trials_nothing_is_said_of_what_matters(made_up, tmp_path, count):
    store, plan = made_up("error", count=count)
    summary = write_report(tmp_path, store, plan.described())
    assert summary.importances == {"error": {}}
    assert importance_table(summary) == "Too few trials to estimate which parameters matter."
    assert {path.name for path in tmp_path.glob("*.png")} == {"history.png", "parallel.png"}


def test_where_all_values_are_equal_nothing_matters(made_up):
    store, plan = made_up("error", "time", "map")
    summary = summarize(store, plan.objectives)
    assert sum(summary.importances["map"].values()) == pytest.approx(0.0)
    assert "nan" not in importance_table(summary)


def test_how_many_trials_and_why_some_failed(made_up):
    store, plan = made_up("error")
    assert counts(summarize(store, plan.objectives)) == (
        "30 trials with values, 3 failed, 1 lost or in flight. Trial 30, 31: the robot left the map. "
        "Trial 32: a trajectory is not finite."
    )
    store, plan = made_up("error", count=1, name="one", failures=False)
    assert counts(summarize(store, plan.objectives)) == "1 trial with values, 0 failed, 0 lost or in flight."


def test_the_best_configuration_can_be_run(made_up, tmp_path):
    store, plan = made_up("error")
    plan = dataclasses.replace(plan, base={"sensor.z_hit": 0.9, "method": "rbpf", "map.margin": 5.0})
    summary = write_report(tmp_path, store, plan.described())
    best = summary.best.params
    text = (tmp_path / "best.toml").read_text()
    # The log's scans choose the lidar.
    assert "[lidar]" not in text
    wanted = SlamConfig().with_method(best["method"])
    rest = {name: value for name, value in best.items() if name != "method"}
    wanted = update(wanted, {"sensor.z_hit": 0.9, "map.margin": 5.0, **rest}, exact=True)
    assert flatten(toml.load(tmp_path / "best.toml")) == flatten(wanted)
    assert toml.load(tmp_path / "best.toml").num_particles == best["num_particles"]


def test_a_lidar_that_is_tuned_is_written_and_is_that_of_the_log(made_up, tmp_path):
    store, plan = made_up("error")
    source = dataclasses.replace(plan.sources[0], lidar="lds-01")
    plan = dataclasses.replace(plan, base={"lidar.usable_range": 3.0}, sources=(source,))
    summary = write_report(tmp_path, store, plan.described())
    found = toml.load(tmp_path / "best.toml")
    assert flatten(found) == flatten(plan.configuration(summary.best.params, "lds-01"))
    assert (found.lidar.usable_range, found.lidar.max_range) == (3.0, 3.5)


def test_what_is_written(made_up, tmp_path):
    store, plan = made_up("error")
    summary = write_report(tmp_path, store, plan.described())
    names = {path.name for path in tmp_path.iterdir()} - {"study.db", "plan.toml"}
    assert names == {"report.md", "trials.json", "best.toml", *PICTURES}
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert text.startswith("# try\n")
    for part in (counts(summary), trial_table(summary), importance_table(summary)):
        assert part in text
    rows = json.loads((tmp_path / "trials.json").read_text())
    assert len(rows) == 34
    assert rows[summary.best.number]["values"] == summary.best.values
    assert rows[summary.best.number]["settings"] == summary.best.params
    assert [row["failure"] for row in rows[30:]] == [
        *["the robot left the map"] * 2,
        "a trajectory is not finite",
        None,
    ]


def test_every_trial_of_the_front_is_a_file_and_those_of_before_go(made_up, tmp_path):
    store, plan = made_up("error", "time")
    (tmp_path / "front-99.toml").write_text("of an earlier report")
    summary = write_report(tmp_path, store, plan.described())
    files = {path.name: path for path in tmp_path.glob("front-*.toml")}
    assert set(files) == {f"front-{trial.number}.toml" for trial in summary.front}
    for trial in summary.front:
        assert (
            toml.load(files[f"front-{trial.number}.toml"]).sensor.sigma_hit
            == trial.params["sensor.sigma_hit"]
        )
    assert {path.name for path in tmp_path.glob("*.png")} == {*PICTURES, "pareto.png"}
    assert "Stars mark the Pareto front" in (tmp_path / "report.md").read_text()


def pixels_of(path, color):
    """How many pixels of a picture have that very color."""
    wanted = np.round(255 * np.array(to_rgb(color)))
    with Image.open(path) as picture:
        return int((np.asarray(picture.convert("RGB")) == wanted).all(axis=-1).sum())


@pytest.mark.parametrize("objectives", [("error",), ("error", "time"), ("error", "time", "heading")])
def test_pictures_show_something(made_up, tmp_path, objectives):
    store, plan = made_up(*objectives)
    write_report(tmp_path, store, plan.described())
    found = {path.name for path in tmp_path.glob("*.png")}
    assert found == PICTURES | ({"pareto.png"} if len(objectives) == 2 else set())
    # The curve of the best so far, the best trial's line, the bars, the front.
    for name in found:
        color = style.ESTIMATE if name in ("history.png", "importance.png") else style.REFERENCE
        assert pixels_of(tmp_path / name, color) > 100, name


def test_parallel_coordinates(made_up):
    store, plan = made_up("error")
    summary = summarize(store, plan.objectives)
    figure = Figure()
    draw_parallel(figure, summary)
    [ax] = figure.axes
    curves = [line.get_ydata() for line in ax.lines if len(line.get_ydata()) == 5]
    assert len(curves) == 30
    # The best is drawn last; worst and best of a column stand at its ends.
    drawn = np.array(curves)
    np.testing.assert_allclose(drawn[-1][-1], 0.0)
    np.testing.assert_allclose(drawn[0][-1], 1.0)
    sigma = np.log([trial.params["sensor.sigma_hit"] for trial in summary.complete[::-1]])
    np.testing.assert_allclose(drawn[:, 0], (sigma - sigma.min()) / np.ptp(sigma), atol=1e-9)
    # Those without the parameter run below its axis.
    lacks = ["proposal.lost_below" not in trial.params for trial in summary.complete[::-1]]
    np.testing.assert_array_equal(drawn[:, 3] < 0, lacks)
    assert set(drawn[:, 2]) == {0.0, 1.0}
    shown = {text.get_text() for text in ax.texts}
    assert {"rbpf", "gmapping", "none"} <= shown
    labels = [label.get_text().replace("\n", "") for label in ax.get_xticklabels()]
    assert labels == ["sensor.sigma_hit", "num_particles", "method", "proposal.lost_below", "error, m"]


def test_one_trial_that_is_far_worse_hides_no_other(made_up):
    store, plan = made_up("error", failures=False)
    add(store, [400.0], sensor__sigma_hit=0.4, num_particles=5, method="rbpf")
    figure = Figure()
    module._draw_history(figure, summarize(store, plan.objectives))
    assert figure.axes[0].get_yscale() == "log"


def test_of_a_study_without_values_there_is_no_report(made_up, tmp_path):
    store, plan = made_up("error", count=0)
    with pytest.raises(ValueError, match="no trial of this study has values yet"):
        write_report(tmp_path, store, plan.described())
    summary = summarize(store, plan.objectives)
    assert summary.complete == summary.front == ()
    assert counts(summary).startswith("0 trials with values, 3 failed, 1 lost")
