"""Small plans and studies for these tests."""

import dataclasses
from pathlib import Path

import numpy as np

from jaxslam.study.objectives import Figures
from jaxslam.study.plan import Plan, read_plan
from jaxslam.study.storage import Store, open_study, storage_url

STUDY = '[study]\nname = "try"\n'
LOGS = '[[logs]]\nworld = "hall_small"\nduration = 10\n'
# A filter that compiles and runs fast.
FILTER = """[filter]
num_particles = 3
map.margin = 4.0
map.window = 8.0
lidar.usable_range = 6.0
"""
SPACE = """[space]
"sensor.sigma_hit" = { low = 0.02, high = 0.5, log = true }
"motion.rotation_floor" = { low = 0.01, high = 0.1 }
"""


def write_plan(
    folder: Path, study: str = STUDY, logs: str = LOGS, space: str = SPACE, rest: str = ""
) -> Path:
    """A study's file in a folder."""
    path = folder / "plan.toml"
    path.write_text(f"{study}\n{rest}\n{logs}\n{space}", encoding="utf-8")
    return path


def plan_of(folder: Path, *texts: str, **changes) -> Plan:
    """The plan of such a file, with other values of its fields."""
    return dataclasses.replace(read_plan(write_plan(folder, *texts)), **changes)


def store_of(plan: Plan, folder: Path) -> Store:
    """Its study in `study.db`."""
    return open_study(plan, url_of(folder))


def url_of(folder: Path) -> str:
    return storage_url(str(folder / "study.db"))


def figures(error: float, *, map_loss: float = 0.5, ms_per_scan: float = 2.0) -> Figures:
    """What two runs were worth; the second twice as bad."""
    return Figures(
        error=np.array([error, 2 * error]),
        heading=np.array([10 * error, 20 * error]),
        map_loss=np.array([map_loss, map_loss]),
        ms_per_scan=ms_per_scan,
    )


def bowl(plan, source, seeds, settings):
    """In place of `measure`: least where sigma_hit is 0.1 and the heading's noise 0.03."""
    return [
        figures(
            0.1
            + np.log(tried.get("sensor.sigma_hit", 0.2) / 0.1) ** 2
            + 100 * (tried.get("motion.rotation_floor", 0.05) - 0.03) ** 2
        )
        for tried in settings
    ]
