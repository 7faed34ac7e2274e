"""The run folder: map, trajectory, figures, metrics and the configuration of a run."""

import json
import math
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxslam.config import toml
from jaxslam.config.dotted import flatten
from jaxslam.config.slam import SlamConfig
from jaxslam.io import write_map, write_tum
from jaxslam.pipeline.localize import LocalizationResult
from jaxslam.pipeline.run import RunResult
from jaxslam.report.provenance import peak_rss_mb, versions
from jaxslam.viz.maps import Poses
from jaxslam.viz.picture import MapLayer, save_map_picture

_LOG_SUFFIXES = (".gz", ".log", ".clf", ".carmen", ".bag", ".mcap", ".db3")


def default_folder(log: Path, method: str, seed: int | None = None) -> Path:
    """Return the default run folder, `runs/<log>-<method>-s<seed>`, without the last part if it has no seed.

    Example:
        `default_folder(Path("data/intel.clf.gz"), "gmapping", 0)` is `runs/intel-gmapping-s0`.
    """
    name = log.resolve().name
    while name.endswith(_LOG_SUFFIXES):
        name = name[: name.rindex(".")]
    return Path("runs") / f"{name or 'log'}-{method}{'' if seed is None else f'-s{seed}'}"


def make_folder(folder: Path, flag: str = "--out") -> None:
    """Create the folder of a `flag` if needed. The files of an existing folder will be overwritten.

    Raises:
        ValueError: the path is a file, or the folder cannot be created or is not writable.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"{folder}: is a file, not a folder: give another with {flag}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # Write a file instead of checking the mode, because some file systems refuse what the mode allows.
        # The check runs before the work, so that no result is lost.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        action = "be written to" if folder.is_dir() else "be created"
        raise ValueError(f"{folder}: cannot {action} ({error.strerror}): give another with {flag}") from None


def save_run(result: RunResult, folder: Path) -> Path:
    """Write a run into a folder, created if needed; this is the body of `RunResult.save`.

    Returns:
        The path of the picture of the map.
    """
    make_folder(folder)
    write_run(folder, result, origin={"versions": versions()})
    return folder / "map.png"


def write_run(
    folder: Path,
    result: RunResult,
    *,
    origin: Mapping[str, object],
    accuracy: Mapping[str, object] | None = None,
    truth: MapLayer | Poses | None = None,
) -> dict[str, object]:
    """Write every result of a run into an existing folder.

    Args:
        folder: existing folder.
        result: result of `run_log`.
        origin: command, seed, log and versions, for `run.json`.
        accuracy: errors by metric, for `metrics.json`.
        truth: true map and path, drawn beside the estimate, or reference poses, drawn over it; in its frame.

    Returns:
        The content of `metrics.json`.

    Raises:
        OSError: a file cannot be written.
    """
    metrics = {**_figures(result), **(accuracy or {})}
    _write_map_files(folder, result, truth)
    _save_ess_picture(folder / "ess.png", result)
    config = result.scans.config
    if isinstance(config, SlamConfig):
        lidar = None if config.lidar is None else config.lidar.name
        origin = {"method": config.method, "lidar": lidar, **origin}
    write_records(folder, result, origin, metrics)
    return metrics


def write_records(
    folder: Path,
    result: RunResult | LocalizationResult,
    origin: Mapping[str, object],
    metrics: Mapping[str, object],
) -> None:
    """Write trajectory, configuration, `run.json` and `metrics.json` of a run or a localization."""
    write_tum(folder / "trajectory.tum", result.all_stamps, result.all_poses)
    config = result.scans.config
    if config is not None:
        toml.save(folder / "config.toml", config)
        origin = {**origin, "configuration": flatten(config)}
    write_json(folder / "run.json", origin)
    write_json(folder / "metrics.json", metrics)


def write_json(path: Path, content: Mapping[str, object]) -> None:
    """Write strict JSON; a number that is not finite becomes null."""
    text = json.dumps(_strict(content), indent=2, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def _write_map_files(folder: Path, result: RunResult, truth: MapLayer | Poses | None) -> None:
    """Write `map.yaml` and `map.pgm` for map_server and nav2, and `map.png`, the picture."""
    map = result.occupancy()
    x, y, theta = map.origin.tolist()
    write_map(folder / "map.yaml", map.probability, map.resolution, (x, y, theta))
    save_map_picture(
        folder / "map.png",
        result.log_odds,
        map.resolution,
        np.asarray(result.grid.origin, np.float64),
        poses=result.all_poses,
        particles=result.particles,
        weights=np.exp(result.log_weights.astype(np.float64)),
        truth=truth,
    )


def _figures(result: RunResult) -> dict[str, object]:
    return {
        "scans_in": result.scans.num_scans,
        "scans_processed": len(result.stamps),
        "compile_s": result.compile_s,
        "run_s": result.run_s,
        "ms_per_scan": result.ms_per_scan,
        "peak_rss_mb": peak_rss_mb(),
        "resamplings": int(np.count_nonzero(result.resampled)),
        "ess_mean": float(np.mean(result.ess)),
    }


def _save_ess_picture(path: Path, result: RunResult) -> None:
    from matplotlib.figure import Figure

    from jaxslam.viz.curves import plot_ess

    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    config = result.scans.config
    threshold = float(config.resampling.threshold) if isinstance(config, SlamConfig) else None
    plot_ess(result.ess, len(result.particles), result.resampled, figure.subplots(), threshold=threshold)
    figure.savefig(path, dpi=150)


def _strict(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): _strict(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
