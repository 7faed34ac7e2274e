"""Write run folders: results, metrics, pictures and their provenance."""

from jaxslam.metrics.summary import relation_figures, trajectory_figures
from jaxslam.report.folder import default_folder, make_folder, write_run
from jaxslam.report.provenance import file_sha256, peak_rss_mb, versions

__all__ = [
    "default_folder",
    "file_sha256",
    "make_folder",
    "peak_rss_mb",
    "relation_figures",
    "trajectory_figures",
    "versions",
    "write_run",
]
