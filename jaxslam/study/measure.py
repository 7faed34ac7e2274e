"""Run configurations on the sources of a study and measure the results; equal programs run together."""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float64, Int8

from jaxslam.config.dotted import Scalar
from jaxslam.config.lidar_presets import PRESETS, LidarPreset, detect_lidar
from jaxslam.core.trajectory import Trajectory
from jaxslam.grid.spec import GridSpec
from jaxslam.io import Relations, SensorLog, read_log, read_relations, read_tum
from jaxslam.metrics import BinaryMap, map_score
from jaxslam.metrics.summary import reference_error, relation_figures
from jaxslam.pipeline.inputs import PreparedScans, pair_scans
from jaxslam.pipeline.many import run_many
from jaxslam.pipeline.many_result import ManyResult
from jaxslam.pipeline.prepare import prepare
from jaxslam.pipeline.run import poses_at_every_scan
from jaxslam.preprocess.ranges import correct_scans
from jaxslam.sim import World, drive, true_map
from jaxslam.slam.rbpf import RBPF
from jaxslam.study.objectives import Figures
from jaxslam.study.plan import DRIVE, Plan, Source

TOLERANCE = 0.1
"""Largest distance of a mapped wall from a true one, meters."""


class TrialError(ValueError):
    """A configuration whose runs cannot be measured; the message is the reason."""


@dataclass(frozen=True)
class LoadedSource:
    """A source in memory.

    Attributes:
        log: the log to map.
        lidar: name of the preset, or the properties detected from the scans if no preset fits.
        reference: true or reference trajectory; None if unknown.
        relations: relations of the benchmark; None if unknown.
        world: the simulated world; None for a log.
    """

    log: SensorLog
    lidar: str | LidarPreset
    reference: Trajectory | None = None
    relations: Relations | None = None
    world: World | None = None


def load(source: Source) -> LoadedSource:
    """Read a log or simulate a drive; the result is cached for all lidars.

    Raises:
        ValueError: a file cannot be used, one line.
        OSError: a file cannot be read.
    """
    loaded = _loaded(dataclasses.replace(source, lidar=None))
    return loaded if source.lidar is None else dataclasses.replace(loaded, lidar=source.lidar)


@functools.lru_cache(maxsize=16)
def _loaded(source: Source) -> LoadedSource:
    if source.world is not None:
        # Another key than the filters', so that their noise is independent of the simulator's.
        key = jax.random.fold_in(jax.random.key(source.seed), 1)
        log, truth = drive(source.world, key=key, duration=float(source.duration or DRIVE))
        return LoadedSource(log, "sick", Trajectory(truth.stamps, truth.poses), world=truth.world)
    assert source.log is not None
    log = read_log(source.log)
    if source.duration is not None:
        log = log.between(0.0, source.duration)
    lidar = detect_lidar(log)
    return LoadedSource(
        log,
        lidar.name if lidar.name in PRESETS else lidar,
        None if source.reference is None else read_tum(Path(source.reference)),
        None if source.relations is None else read_relations(source.relations),
    )


def check_source(plan: Plan, source: Source) -> None:
    """Measure the odometry of a source, before any run is made.

    Raises:
        ValueError: the source has no odometry, or no overlap with its reference; one line.
        OSError: the source cannot be read.
    """
    loaded = load(source)
    configuration = plan.configuration({}, loaded.lidar)
    try:
        assert configuration.lidar is not None  # `load` has set it
        log, _ = correct_scans(loaded.log, configuration.lidar)
        inputs = pair_scans(log, configuration.thinning)
        _errors(loaded, inputs, inputs.all_odometry)
    except ValueError as error:
        raise ValueError(f"{source.name}: {error}") from None


def measure(
    plan: Plan, source: Source, seeds: Sequence[int], settings: Sequence[Mapping[str, Scalar]]
) -> list[Figures | TrialError]:
    """Return the figures of every configuration on one source, or the reason for a failure.

    Configurations that differ only in traced numbers share a program. They run together, unless time is an
    objective.
    """
    loaded = load(source)
    found: dict[int, Figures | TrialError] = {}
    groups: dict[Any, list[tuple[int, RBPF, PreparedScans]]] = {}
    for index, each in enumerate(settings):
        try:
            slam, scans, feed = _prepared(plan, source, loaded, each)
        except (ValueError, OverflowError) as error:
            found[index] = TrialError(str(error))
            continue
        apart = index if "time" in plan.objectives else None
        program = (feed, jax.tree.structure(slam), apart)
        groups.setdefault(program, []).append((index, slam, scans))
    keys = jnp.stack([jax.random.key(seed) for seed in seeds])
    for members in groups.values():
        _, first, scans = members[0]
        filters = [slam for _, slam, _ in members]
        try:
            result = run_many(first, scans, keys, filters, maps="map" in plan.objectives)
        except (ValueError, jax.errors.JaxRuntimeError) as error:
            # Messages of XLA can be pages long.
            reason = str(error).strip().partition("\n")[0]
            for index, *_ in members:
                found[index] = TrialError(reason)
            continue
        for row, (index, slam, scans) in enumerate(members):
            try:
                found[index] = _figures(loaded, slam, scans, result, row)
            except ValueError as error:
                found[index] = TrialError(str(error))
    return [found[index] for index in range(len(settings))]


def _prepared(
    plan: Plan, source: Source, loaded: LoadedSource, settings: Mapping[str, Scalar]
) -> tuple[RBPF, PreparedScans, tuple[Any, ...]]:
    """Return the filter, its scans, and everything that the scans depend on."""
    configuration = plan.configuration(settings, loaded.lidar)
    return *prepare(loaded.log, configuration), (
        *jax.tree.leaves(configuration.lidar),
        configuration.thinning,
        *jax.tree.leaves(configuration.fusion),
        jax.tree.structure(configuration.fusion),
    )


def _figures(
    loaded: LoadedSource, slam: RBPF, scans: PreparedScans, result: ManyResult, row: int
) -> Figures | TrialError:
    lost = int(result.left_map[row].sum())
    if lost:
        return TrialError(f"the robot left the map in {lost} of {len(result.left_map[row])} runs")
    if not np.isfinite(result.trajectories[row]).all():
        return TrialError("a trajectory is not finite")
    paths = (poses_at_every_scan(scans, path.astype(np.float64)) for path in result.trajectories[row])
    errors = [_errors(loaded, scans, poses) for poses in paths]
    return Figures(
        error=np.array([error for error, _ in errors]),
        heading=np.array([heading for _, heading in errors]),
        map_loss=_map_losses(loaded, slam.grid, result.log_odds, row),
        ms_per_scan=result.ms_per_scan,
    )


def _errors(
    loaded: LoadedSource, inputs: PreparedScans, poses: Float64[np.ndarray, "S 3"]
) -> tuple[float, float]:
    """Return the errors of the poses at all scans, meters and degrees; NaN for a source without reference."""
    if loaded.relations is not None:
        figures = relation_figures(loaded.relations, inputs, poses)
        return figures["trans_mean_m"], figures["rot_mean_deg"]
    if loaded.reference is None:
        return np.nan, np.nan
    error = reference_error(loaded.reference, inputs, poses)
    return error.rmse_m, error.rot_rmse_deg


def _map_losses(
    loaded: LoadedSource, grid: GridSpec, log_odds: Int8[np.ndarray, "C S H W"] | None, row: int
) -> Float64[np.ndarray, "S"]:
    """Return one minus the IoU of the walls, by seed; empty if no map was kept, and for a log."""
    if loaded.world is None or log_odds is None:
        return np.zeros(0)
    assert loaded.reference is not None
    start = jnp.asarray(loaded.reference.poses[0, :2], jnp.float32)
    truth = true_map(loaded.world, grid, start)
    maps = (BinaryMap.from_log_odds(each, grid.resolution, grid.origin) for each in log_odds[row])
    return np.array([1.0 - map_score(truth, each, tolerance_m=TOLERANCE).iou for each in maps])


def program_of(plan: Plan, source: Source, settings: Mapping[str, Scalar]) -> Any:
    """Return a key that is equal for configurations that share a program: structure and sizes."""
    slam, scans, _ = _prepared(plan, source, load(source), settings)
    return jax.tree.structure(slam), (len(scans.stamps) - 1).bit_length()
