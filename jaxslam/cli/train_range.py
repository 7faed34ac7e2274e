"""`jaxslam train-range DATA…`."""

import shlex
import time

import jax

from jaxslam.cli.arguments import TrainRange
from jaxslam.cli.common import check_seed, warn
from jaxslam.range_network import save_network
from jaxslam.range_network.learning import Attempt, Split, check_sizes, learn
from jaxslam.range_network.readings import Readings, read_readings
from jaxslam.report import file_sha256, make_folder, versions
from jaxslam.report.range_network import PAPERS_MSE, error_table, role_errors, write_training


def execute(command: TrainRange, arguments: list[str]) -> None:
    """Trains a network on readings of a wall, and writes it and how well it does."""
    check_seed(command.seed)
    check_sizes(command.neurons, command.restarts)
    if not command.data:
        raise ValueError("give readings to learn from: FILE.csv, or LOG:METRES of a wall (see --help)")
    readings = Readings.joined([read_readings(source, bearing=command.bearing) for source in command.data])
    if readings.num_lost:
        warn([f"{readings.num_lost} readings without a return are left out"])
    if len(readings.distances) < 2:
        raise ValueError(
            f"all readings are at one distance ({readings.distances[0]:g} m): what a lidar is off by from "
            "one distance to another takes two or more"
        )
    split = Split.of(readings, command.held_out or None)
    if not split.validation.any():
        warn(["too few distances to validate at some of them: only the mean reading of each is learnt"])
    # Before the training: a name that cannot be written should not cost it.
    if command.out.is_dir():
        raise ValueError(f"{command.out}: is a folder: give the name of a file")
    folder = command.out.with_name(f"{command.out.stem}-training")
    make_folder(folder)
    print(f"readings  {len(readings.true)} at {len(readings.distances)} distances")

    def say(attempt: Attempt) -> None:
        print(
            f"neurons   {attempt.num_neurons}: RMSE {1e3 * attempt.rmse[0]:.2f} mm in training, "
            f"{1e3 * attempt.rmse[1]:.2f} mm in validation after {attempt.steps} steps, best of "
            f"{command.restarts}",
            flush=True,
        )

    begun = time.perf_counter()
    learnt = learn(
        jax.random.key(command.seed),
        readings,
        split,
        neurons=command.neurons,
        restarts=command.restarts,
        method=command.method,
        on_attempt=say,
    )
    seconds = time.perf_counter() - begun
    save_network(command.out, learnt.network)
    origin = {
        "command": shlex.join(["jaxslam", *arguments]),
        "seed": command.seed,
        "method": command.method,
        "seconds": seconds,
        "network": {"path": str(command.out.resolve()), "sha256": file_sha256(command.out)},
        "versions": versions(),
    }
    rows = write_training(folder, learnt, readings, origin)
    print(f"chosen    {learnt.network.num_neurons} neurons, in {seconds:.1f} s with compilation\n")
    print(error_table(rows))
    roles = {row.role: row for row in role_errors(rows)}
    seen = next((row for role, row in roles.items() if role.startswith("learnt")), None)
    if seen is not None:
        print(
            f"\nMSE at distances that were learnt: {seen.corrected_rmse**2:.3g} m² (the paper's: "
            f"{PAPERS_MSE:.3g}). Only those held out\ntell what it is in between: a network can learn a "
            "staircase, right at the distances it was shown."
        )
    if "held out" not in roles:
        print("Nothing was held out: see --held-out.")
    print(f"written   {command.out}, {folder} (errors.png, histograms.png, training.json, …)")
