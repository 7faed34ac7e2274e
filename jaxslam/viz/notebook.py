"""Show results in a notebook: a picture and a table of the main numbers."""

import base64
import html
import io
from collections.abc import Mapping

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from jaxslam.pipeline.localize import LocalizationResult
from jaxslam.pipeline.many import ManyResult
from jaxslam.pipeline.run import RunResult
from jaxslam.viz.clouds import plot_localization
from jaxslam.viz.results import plot_run


def run_png(result: RunResult) -> bytes:
    """Return the picture of a run as the bytes of a PNG file."""
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    plot_run(result, figure.subplots())
    return _png(figure)


def run_html(result: RunResult) -> str:
    """Return the picture of a run above a table of its main numbers, as HTML."""
    height, width = result.log_odds.shape
    side = float(result.grid.resolution)
    rows = {
        "scans": f"{len(result.stamps)} processed of {result.scans.num_scans}",
        "particles": str(len(result.particles)),
        "map": f"{width * side:.1f} × {height * side:.1f} m, cells of {side:.3g} m",
        "time": f"{result.ms_per_scan:.2f} ms per scan, {result.compile_s:.1f} s to compile",
        "resamplings": str(int(result.resampled.sum())),
    }
    rows |= {"warnings": "; ".join(result.warnings)} if result.warnings else {}
    return _picture_html(run_png(result)) + _table_html(rows)


def localization_png(result: LocalizationResult) -> bytes:
    """Return the picture of a localization as the bytes of a PNG file."""
    figure = Figure(figsize=(6.0, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    plot_localization(result, figure.subplots())
    return _png(figure)


def localization_html(result: LocalizationResult) -> str:
    """Return the picture of a localization above a table of its main numbers, as HTML."""
    rows = {
        "scans": f"{len(result.stamps)} processed of {len(result.all_stamps)}",
        "particles": f"{result.infos.num_particles[0]} at first, {len(result.particles)} at the end",
        "converged": "yes" if result.converged else "no",
        "time": f"{result.ms_per_scan:.2f} ms per scan, {result.compile_s:.1f} s to compile",
    }
    rows |= {"warnings": "; ".join(result.warnings)} if result.warnings else {}
    return _picture_html(localization_png(result)) + _table_html(rows)


def many_html(result: ManyResult) -> str:
    """Return a table of the main numbers of many runs, as HTML."""
    num_configs, num_keys, num_scans, _ = result.trajectories.shape
    rows = {
        "runs": f"{num_configs} configurations × {num_keys} keys",
        "scans": f"{num_scans} in the longest run",
        "time": f"{result.scans_per_s:.0f} scans per second, {result.compile_s:.1f} s to compile",
        "left the map": f"{int(result.left_map.sum())} of {result.left_map.size} runs",
    }
    return _table_html(rows)


def _picture_html(png: bytes) -> str:
    return f"<img src='data:image/png;base64,{base64.b64encode(png).decode('ascii')}' alt='map'/>"


def _table_html(rows: Mapping[str, str]) -> str:
    """Return a table of two columns, as HTML."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
        f"<td style='text-align:left'>{html.escape(text)}</td></tr>"
        for name, text in rows.items()
    )
    return f"<table>{cells}</table>"


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()
