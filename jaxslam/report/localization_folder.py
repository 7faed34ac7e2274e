"""The run folder of a localization: trajectory, pictures, metrics and configuration."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxslam.metrics import TrajectoryError
from jaxslam.metrics.summary import trajectory_figures
from jaxslam.pipeline.localize import LocalizationResult
from jaxslam.report.folder import make_folder, write_records
from jaxslam.report.provenance import peak_rss_mb, versions
from jaxslam.viz.clouds import plot_localization, save_localization_curves


def save_localization(result: LocalizationResult, folder: Path) -> Path:
    """Write a localization into a folder, created if needed; this is the body of `LocalizationResult.save`.

    Returns:
        The path of the picture.
    """
    make_folder(folder)
    write_localization(folder, result, origin={"versions": versions()})
    return folder / "cloud.png"


def write_localization(
    folder: Path,
    result: LocalizationResult,
    *,
    origin: Mapping[str, object],
    error: TrajectoryError | None = None,
) -> dict[str, object]:
    """Write every result of a localization into an existing folder.

    Args:
        folder: existing folder.
        result: result of `localize_log`.
        origin: command, seed, log, map, start and versions, for `run.json`.
        error: trajectory error against a reference, or None.

    Returns:
        The content of `metrics.json`.

    Raises:
        OSError: a file cannot be written.
    """
    metrics = _figures(result)
    if error is not None:
        metrics["ate"] = trajectory_figures(error)
    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    plot_localization(result, figure.subplots(), legend=False)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    figure.savefig(folder / "cloud.png", dpi=150)
    save_localization_curves(folder / "particles.png", result)
    write_records(folder, result, origin, metrics)
    return metrics


def _figures(result: LocalizationResult) -> dict[str, object]:
    agreed, infos = result.agreed, result.infos
    after = result.converged_after_s
    beams = min(result.scans.inputs.scan.num_beams, result.scored_beams)
    evaluated = float(np.sum(np.asarray(infos.num_particles, float))) * beams
    scores = np.asarray(infos.match_score, float)
    # The score counts only while the particles agree, because otherwise there is no estimate.
    counted = scores[agreed & np.isfinite(scores)]
    return {
        "scans_in": len(result.all_stamps),
        "scans_processed": len(result.stamps),
        "converged": result.converged,
        "converged_after_s": None if np.isnan(after) else after,
        "kidnapped_events": result.kidnapped_events,
        "lost_steps": int(np.count_nonzero(infos.lost)),
        "match_score": float(counted.mean()) if counted.size else float("nan"),
        "particles_median": float(np.median(infos.num_particles)),
        "particles_max": int(np.max(infos.num_particles)),
        "random_particles": int(np.sum(infos.num_random, dtype=np.int64)),
        "resamplings": int(np.count_nonzero(infos.resampled)),
        "compile_s": result.compile_s,
        "run_s": result.run_s,
        "ms_per_scan": result.ms_per_scan,
        "beam_evaluations_per_s": evaluated / result.run_s,
        "peak_rss_mb": peak_rss_mb(),
    }
