"""`jaxslam train-range DATA…`."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from jaxslam.cli import common

if TYPE_CHECKING:
    from jaxslam.range_network.learning import Attempt


@dataclass(frozen=True)
class TrainRange:
    """Flags of `jaxslam train-range`."""

    data: Annotated[tuple[str, ...], Positional, arg(metavar="DATA", help_behavior_hint="(required)")]
    """Readings: tables (FILE.csv with the columns true_m and measured_m), or logs of a robot that faces a
    wall, each with the distance from lidar to wall in meters (wall.mcap:1.5); repeatable."""
    out: Annotated[Path, arg(metavar="FILE")] = Path("network.eqx")
    """Output file of the network. The error table and the figures go to a folder beside it,
    <name>-training."""
    neurons: Annotated[tuple[int, ...], arg(metavar="N [N …]")] = (50,)
    """Neurons of the hidden layer. Of several sizes, the one with the lowest validation error is kept."""
    restarts: Annotated[int, arg(metavar="N")] = 5
    """Trainings per size, each from another initialization; the one with the lowest validation error is
    kept."""
    held_out: Annotated[
        tuple[float, ...],
        arg(metavar="METERS [METERS …]", help_behavior_hint="(default: every fifth of 10 or more)"),
    ] = ()
    """Distances excluded from training, to measure the error at."""
    method: Literal["levenberg-marquardt", "adam"] = "levenberg-marquardt"
    """Optimizer. Adam is slower and serves for comparison."""
    bearing: Annotated[float, arg(metavar="RAD")] = 0.0
    """Bearing of the beam that faces the wall, in the lidar frame, radians (logs only)."""
    seed: int = 0
    """Random seed of the initializations, 0 to 4294967295."""


def execute(command: TrainRange, arguments: list[str]) -> None:
    """Train a network on readings of a wall, and write it with its errors."""
    import jax

    from jaxslam.range_network import save_network
    from jaxslam.range_network.learning import Split, check_sizes, learn
    from jaxslam.range_network.readings import Readings, read_readings
    from jaxslam.report import make_folder
    from jaxslam.report.training_folder import PAPERS_MSE, error_table, role_errors, write_training

    check_sizes(command.neurons, command.restarts)
    if not command.data:
        raise ValueError("give training readings: FILE.csv, or LOG:METERS of a wall (see --help)")
    readings = Readings.joined([read_readings(source, bearing=command.bearing) for source in command.data])
    if readings.num_lost:
        common.warn(f"{readings.num_lost} readings without a return are left out")
    if len(readings.distances) < 2:
        raise ValueError(
            f"all readings are at one distance ({readings.distances[0]:g} m): give readings at two or more "
            "distances"
        )
    split = Split.from_readings(readings, command.held_out or None)
    if not split.validation.any():
        common.warn(
            "too few distances for a validation set: only the mean reading of each distance is learned"
        )
    # Check the output before the training, so that a bad name does not waste it.
    if command.out.is_dir():
        raise ValueError(f"{command.out}: is a folder: give a file name")
    folder = command.out.with_name(f"{command.out.stem}-training")
    make_folder(folder)
    print(f"readings  {len(readings.true)} at {len(readings.distances)} distances")

    def say(attempt: "Attempt") -> None:
        print(
            f"neurons   {attempt.num_neurons}: RMSE {1e3 * attempt.rmse[0]:.2f} mm in training, "
            f"{1e3 * attempt.rmse[1]:.2f} mm in validation after {attempt.steps} steps, best of "
            f"{command.restarts}",
            flush=True,
        )

    begun = time.perf_counter()
    trained = learn(
        jax.random.key(command.seed),
        readings,
        split,
        neurons=command.neurons,
        restarts=command.restarts,
        method=command.method,
        on_attempt=say,
    )
    seconds = time.perf_counter() - begun
    save_network(command.out, trained.network)
    origin = common.origin_of(arguments, command.seed, network=command.out)
    origin |= {"method": command.method, "seconds": seconds}
    rows = write_training(folder, trained, readings, origin)
    print(f"chosen    {trained.network.num_neurons} neurons, in {seconds:.1f} s with compilation\n")
    print(error_table(rows))
    roles = {row.role: row for row in role_errors(rows)}
    if seen := roles.get("training"):
        print(
            f"\nMSE at training distances: {seen.corrected_rmse**2:.3g} m² (Jamaludin et al.: "
            f"{PAPERS_MSE:.3g}). Only held-out distances\nshow the error in between: a network can fit a "
            "staircase that is right at the training distances alone."
        )
    if "held out" not in roles:
        print("No distance was held out: see --held-out.")
    print(f"written   {command.out}, {folder} (errors.png, histograms.png, training.json, …)")
