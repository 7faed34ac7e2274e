"""Vectorized Rao-Blackwellized particle-filter SLAM for 2D lidar, in JAX.

This module exports the names of a first session; all other names are in the packages. Each name is loaded at
its first use (PEP 562), so `import jaxslam` imports nothing else.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxslam import (
        fusion,
        grid,
        io,
        lidar,
        localization,
        matching,
        metrics,
        motion,
        proposal,
        range_network,
        resampling,
        sensor,
        sim,
        slam,
    )
    from jaxslam import study as study
    from jaxslam import viz as viz
    from jaxslam.config.localization import LocalizationConfig
    from jaxslam.config.slam import SlamConfig
    from jaxslam.io.log import LogError, SensorLog
    from jaxslam.io.reader import read_log
    from jaxslam.pipeline.inputs import PreparedScans
    from jaxslam.pipeline.localize import LocalizationResult, localize_log
    from jaxslam.pipeline.many import run_many
    from jaxslam.pipeline.many_result import ManyResult
    from jaxslam.pipeline.prepare import prepare, prepare_localization
    from jaxslam.pipeline.run import RunResult, run_log
    from jaxslam.slam.rbpf import RBPF

    __version__: str

__all__ = [
    "RBPF",
    "LocalizationConfig",
    "LocalizationResult",
    "LogError",
    "ManyResult",
    "PreparedScans",
    "RunResult",
    "SensorLog",
    "SlamConfig",
    "__version__",
    "fusion",
    "grid",
    "io",
    "lidar",
    "localization",
    "localize_log",
    "matching",
    "metrics",
    "motion",
    "prepare",
    "prepare_localization",
    "proposal",
    "range_network",
    "read_log",
    "resampling",
    "run_log",
    "run_many",
    "sensor",
    "sim",
    "slam",
]

_MODULES = {
    "RBPF": "slam.rbpf",
    "LocalizationConfig": "config.localization",
    "LocalizationResult": "pipeline.localize",
    "LogError": "io.log",
    "ManyResult": "pipeline.many_result",
    "PreparedScans": "pipeline.inputs",
    "RunResult": "pipeline.run",
    "SensorLog": "io.log",
    "SlamConfig": "config.slam",
    "localize_log": "pipeline.localize",
    "prepare": "pipeline.prepare",
    "prepare_localization": "pipeline.prepare",
    "read_log": "io.reader",
    "run_log": "pipeline.run",
    "run_many": "pipeline.many",
}
"""The module in `jaxslam` that defines each name; all other names in `__all__` are packages."""

_OPTIONAL = ("study", "viz")
"""Packages that need extras: `__all__` leaves them out, so that `help(jaxslam)` works without the extras."""


def __getattr__(name: str) -> object:
    value: object
    if name == "__version__":
        value = importlib.import_module("importlib.metadata").version("jaxslam")
    elif name in _MODULES:
        value = getattr(importlib.import_module(f"jaxslam.{_MODULES[name]}"), name)
    elif name in __all__ or name in _OPTIONAL:
        value = importlib.import_module(f"jaxslam.{name}")
    else:
        raise AttributeError(f"module 'jaxslam' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
