"""The methods compared, as configurations."""

from dataclasses import dataclass, field
from typing import Any

from experiments.tobacco_line.methods import ODOMETRY_NOISE
from jaxslam.configuration import Configuration
from jaxslam.presets import PRESETS
from jaxslam.settings import update


@dataclass(frozen=True)
class Method:
    """A row of the table.

    Attributes:
        title: for people.
        method: of `jaxslam.configuration.METHODS`.
        particles: how many.
        changes: settings that differ from the method's defaults.
    """

    title: str
    method: str
    particles: int
    changes: dict[str, Any] = field(default_factory=dict)

    def configuration(self) -> Configuration:
        """The whole filter."""
        base = Configuration(num_particles=self.particles).with_lidar(PRESETS["vlp-16"])
        chosen = update(base.with_method(self.method), ODOMETRY_NOISE, exact=True)
        return update(chosen, self.changes, exact=True)


MAPPED = {
    "traditional-15": Method("traditional FastSLAM", "rbpf", 15),
    "traditional-30": Method("traditional FastSLAM", "rbpf", 30),
    "traditional-100": Method("traditional FastSLAM", "rbpf", 100),
    "traditional-300": Method("traditional FastSLAM", "rbpf", 300),
    "optimised-5": Method("optimised FastSLAM", "gaussian", 5),
    "optimised-15": Method("optimised FastSLAM", "gaussian", 15),
    "optimised-30": Method("optimised FastSLAM", "gaussian", 30),
    "constant-odometry-15": Method(
        "optimised, odometry constant near the mode (18)", "gaussian", 15, {"proposal.odometry_weight": 0.0}
    ),
    "gmapping-15": Method("scan matching as gmapping", "gmapping", 15),
}
"""The paper's comparison over particle numbers, and two more."""
DRAWN = {"traditional-30": "tab:red", "optimised-15": "tab:blue"}
"""Those in the figures, with their colours."""
