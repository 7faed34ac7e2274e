"""How long a whole run takes, as a user gets it: the command in a process of its own, without shape checks.

The simulated hall always; the Intel log where `JAXSLAM_DATA` (or the default folder) has it.
"""

import json
import os
import statistics
import subprocess
import sys

import pytest

NUM_SEEDS = 3
_COMMAND = (sys.executable, "-m", "jaxslam.cli")


def run_seeds(benchmark, folder, name, num_particles, arguments):
    """Times whole processes; compilation and steady time are what each of them reports of itself.

    Returns:
        The metrics of every run.
    """
    reported = []

    def run():
        out = folder / str(len(reported))
        seeded = [
            *arguments,
            "--particles",
            str(num_particles),
            "--seed",
            str(len(reported)),
            "--out",
            str(out),
        ]
        # As a user gets it: the tests keep compiled programs, which the second seed would find.
        kept = ("JAX_COMPILATION_CACHE", "JAX_PERSISTENT_CACHE")
        alone = {name: value for name, value in os.environ.items() if not name.startswith(kept)}
        done = subprocess.run([*_COMMAND, *seeded], env=alone, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        reported.append(json.loads((out / "metrics.json").read_text(encoding="utf-8")))

    benchmark.group = name
    benchmark.pedantic(run, rounds=NUM_SEEDS)
    for figure in ("compile_s", "run_s", "ms_per_scan", "peak_rss_mb", "scans_processed"):
        benchmark.extra_info[figure] = statistics.median(metrics[figure] for metrics in reported)
    benchmark.extra_info["num_particles"] = num_particles
    benchmark.extra_info["us_per_scan_and_particle"] = (
        1e3 * benchmark.extra_info["ms_per_scan"] / num_particles
    )
    return reported


@pytest.mark.parametrize("num_particles", [15, 30, 100, 400])
def test_simulated_hall(benchmark, tmp_path, num_particles):
    reported = run_seeds(benchmark, tmp_path, "demo", num_particles, ["demo"])
    # What was timed mapped the hall.
    assert max(metrics["ate"]["rmse_m"] for metrics in reported) < 0.1


@pytest.mark.parametrize("num_particles", [15, 30, 100])
def test_intel(benchmark, tmp_path, data_dir, num_particles):
    log, relations = data_dir / "carmen" / "intel.clf.gz", data_dir / "carmen" / "intel.relations"
    arguments = ["run", str(log), "--relations", str(relations)]
    reported = run_seeds(benchmark, tmp_path, "intel", num_particles, arguments)
    assert max(metrics["relations"]["trans_mean_m"] for metrics in reported) < 0.1
    assert {metrics["relations"]["n"] for metrics in reported} == {2984}
