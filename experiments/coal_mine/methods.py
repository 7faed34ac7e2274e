"""The methods of the comparison, as configurations."""

from functools import partial

from experiments._harness.method import Method

_Mapped = partial(Method, lidar="vlp-16")

MAPPED = {
    "traditional-15": _Mapped("traditional FastSLAM", "rbpf", 15),
    "traditional-30": _Mapped("traditional FastSLAM", "rbpf", 30),
    "traditional-100": _Mapped("traditional FastSLAM", "rbpf", 100),
    "traditional-300": _Mapped("traditional FastSLAM", "rbpf", 300),
    "optimised-5": _Mapped("optimised FastSLAM", "gaussian", 5),
    "optimised-15": _Mapped("optimised FastSLAM", "gaussian", 15),
    "optimised-30": _Mapped("optimised FastSLAM", "gaussian", 30),
    "constant-odometry-15": _Mapped(
        "optimised, odometry constant near the mode (18)", "gaussian", 15, {"proposal.odometry_weight": 0.0}
    ),
    "gmapping-15": _Mapped("scan matching as gmapping", "gmapping", 15),
}
"""The comparison of Yang et al. 2019 over numbers of particles, and two more methods.

Names and titles are spelled as in the stored results.
"""
DRAWN = {"traditional-30": "tab:red", "optimised-15": "tab:blue"}
"""The methods in the figures, with their colors."""
