"""The run folder of a localisation: trajectory, figures, the cloud on the map."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Array, Float, Float32, Float64

from jaxslam.config import toml
from jaxslam.config.dotted import flatten
from jaxslam.config.localization import LocalizationConfig
from jaxslam.core import se2
from jaxslam.io import OccupancyMap, write_tum
from jaxslam.metrics import TrajectoryError
from jaxslam.metrics.summary import trajectory_figures
from jaxslam.pipeline.inputs import PreparedInputs
from jaxslam.pipeline.localize import Cloud, LocalizationResult
from jaxslam.report.folder import write_json
from jaxslam.report.provenance import peak_rss_mb
from jaxslam.viz.animation import MapFrame, animate_map

_MAX_DRAWN = 5000
"""Particles in a picture; more of them are only a darker blot."""


def write_localization(
    folder: Path,
    result: LocalizationResult,
    configuration: LocalizationConfig,
    occupancy: OccupancyMap,
    prepared: PreparedInputs,
    *,
    seed: int,
    origin: Mapping[str, object],
    error: TrajectoryError | None,
) -> dict[str, object]:
    """Writes everything a localisation leaves behind into a folder that is there.

    Args:
        folder: where to.
        result: of `localize_log`.
        configuration: what made it.
        occupancy: the map.
        prepared: the scans, for the picture.
        seed: of its key.
        origin: goes into `run.json`: command, log, map, start, versions.
        error: against a reference, or None.

    Returns:
        What stands in `metrics.json`.

    Raises:
        OSError: a file cannot be written.
    """
    metrics = _figures(result, configuration, prepared)
    if error is not None:
        metrics["ate"] = trajectory_figures(error)
    write_tum(folder / "trajectory.tum", result.all_stamps, result.all_poses)
    _save_picture(folder / "cloud.png", result, occupancy, prepared)
    _save_curves(folder / "particles.png", result)
    toml.save(folder / "config.toml", configuration)
    write_json(
        folder / "run.json",
        {"seed": seed, **origin, "configuration": flatten(configuration)},
    )
    write_json(folder / "metrics.json", metrics)
    return metrics


def animate_clouds(path: Path, occupancy: OccupancyMap, clouds: Sequence[Cloud]) -> None:
    """Writes an animated GIF of the particles on the map."""
    levels, first = occupancy_levels(occupancy), clouds[0].stamp
    frames = (
        MapFrame(
            levels,
            in_map_axes(occupancy, cloud.estimates[-1:]),
            in_map_axes(occupancy, _thinned(cloud.particles)),
            f"{cloud.stamp - first:.0f} s, {len(cloud.particles)} particles",
        )
        for cloud in clouds
    )
    animate_map(path, frames, occupancy.resolution, occupancy.origin[:2], frame_s=0.2)


def occupancy_levels(occupancy: OccupancyMap) -> Float32[np.ndarray, "H W"]:
    """A known map as `plot_map` and the others draw it: 1 occupied, 0 free, NaN unknown."""
    levels = np.full(occupancy.occupied.shape, np.nan, np.float32)
    levels[occupancy.free] = 0.0
    levels[occupancy.occupied] = 1.0
    return levels


def in_map_axes(
    occupancy: OccupancyMap, poses: Float[np.ndarray | Array, "_ 3"]
) -> Float64[np.ndarray, "_ 3"]:
    """World poses as they lie on a drawing of the map, upright even where the map is turned."""
    corner = np.array([*occupancy.origin[:2], 0.0])
    return se2.compose(corner[None], se2.relative(occupancy.origin[None], np.asarray(poses, float)))


def _figures(
    result: LocalizationResult, configuration: LocalizationConfig, prepared: PreparedInputs
) -> dict[str, object]:
    agreed, infos = result.agreed, result.infos
    after = result.converged_after_s
    beams = min(prepared.inputs.scan.num_beams, configuration.scan_model.beams_per_scan)
    evaluated = float(np.sum(np.asarray(infos.num_live, float))) * beams
    scores = np.asarray(infos.match_score, float)
    # Of an estimate that is none, how well it fits says nothing.
    counted = scores[agreed & np.isfinite(scores)]
    return {
        "scans_in": len(result.all_stamps),
        "scans_processed": len(result.stamps),
        "converged": result.converged,
        "converged_after_s": None if np.isnan(after) else after,
        "kidnapped_events": result.kidnapped_events,
        "lost_steps": int(np.count_nonzero(infos.lost)),
        "match_score": float(counted.mean()) if counted.size else float("nan"),
        "particles_median": float(np.median(infos.num_live)),
        "particles_max": int(np.max(infos.num_live)),
        "random_particles": int(np.sum(infos.num_random, dtype=np.int64)),
        "resamplings": int(np.count_nonzero(infos.resampled)),
        "compile_s": result.compile_s,
        "run_s": result.run_s,
        "ms_per_scan": result.ms_per_scan,
        "beam_evaluations_per_s": evaluated / result.run_s,
        "peak_rss_mb": peak_rss_mb(),
    }


def _save_picture(
    path: Path, result: LocalizationResult, occupancy: OccupancyMap, prepared: PreparedInputs
) -> None:
    """The map with the trajectory where the particles agreed, the last scan and the last particles."""
    import jax
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from jaxslam.viz import plot_map, plot_particles, plot_scan, plot_trajectory

    figure = Figure(figsize=(9.0, 8.0), layout="constrained")
    FigureCanvasAgg(figure)
    ax = figure.subplots()
    plot_map(occupancy_levels(occupancy), occupancy.resolution, occupancy.origin[:2], ax, margin_m=0.5)
    known = result.estimates.copy()
    # A gap and not a line across the map where there was no estimate.
    known[~result.agreed] = np.nan
    if result.agreed.any():
        plot_trajectory(in_map_axes(occupancy, known), ax, label="where the particles agree", legend=False)
    last = in_map_axes(occupancy, result.estimates[-1:])[0]
    plot_scan(jax.tree.map(lambda leaf: leaf[-1], prepared.inputs.scan), last, ax, label="last scan")
    count = min(len(result.particles), _MAX_DRAWN)
    heaviest = np.argsort(-result.weights, kind="stable")[:count]
    plot_particles(in_map_axes(occupancy, result.particles[heaviest]), result.weights[heaviest], ax)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    figure.savefig(path, dpi=150)


def _save_curves(path: Path, result: LocalizationResult) -> None:
    """Particles, spread and match over time."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    FigureCanvasAgg(figure)
    live, spread, match = figure.subplots(3, 1, sharex=True)
    seconds = result.stamps - result.stamps[0]
    live.semilogy(seconds, result.infos.num_live, color="tab:blue")
    live.set_ylabel("particles")
    deviation = np.sqrt(result.covariances[:, 0, 0] + result.covariances[:, 1, 1])
    spread.semilogy(seconds, np.maximum(deviation, 1e-3), color="tab:blue")
    spread.set_ylabel("deviation of the\nestimate, m")
    match.plot(seconds, result.infos.match_score, color="tab:blue")
    match.set(ylabel="share of beams\non the map", ylim=(0.0, 1.02), xlabel="time, s")
    for ax in (live, spread, match):
        ax.fill_between(
            seconds, 0, 1, where=~result.agreed, transform=ax.get_xaxis_transform(), color="0.9", linewidth=0
        )
        ax.grid(alpha=0.3)
    live.set_title("grey: the particles do not agree, or the scan does not fit", fontsize="medium")
    figure.savefig(path, dpi=150)


def _thinned(particles: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "m 3"]:
    # Drawn independently of each other, the first are as good as any.
    return particles[:_MAX_DRAWN]
