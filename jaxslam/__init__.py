"""Vectorized Rao-Blackwellized particle-filter SLAM for 2D lidar, in JAX.

The names of a first session are here; every other name is in the package it belongs to. Importing `jaxslam`
costs nothing: each name is loaded when it is first used (PEP 562).
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxslam.config.localization import LocalizationConfig as LocalizationConfig

_HOMES = {
    "Flag": "core.flags",
    "GridSpec": "grid.spec",
    "LidarScan": "core.types",
    "LocalizationConfig": "config.localization",
    "LogError": "io.log",
    "RBPF": "slam.rbpf",
    "RunResult": "pipeline.run",
    "SensorLog": "io.log",
    "SlamConfig": "config.slam",
    "StepInputs": "core.types",
    "Thinning": "config.thinning",
    "prepare": "pipeline.prepare",
    "read_log": "io.reader",
    "run_log": "pipeline.run",
    "run_many": "pipeline.many",
}
"""Module of each name, below `jaxslam`."""

_PACKAGES = (
    "io",
    "grid",
    "lidar",
    "motion",
    "sensor",
    "matching",
    "proposal",
    "resampling",
    "slam",
    "localization",
    "fusion",
    "range_network",
    "metrics",
    "sim",
    "viz",
    "study",
)

__all__ = sorted([*_HOMES, *_PACKAGES])


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version

        return version("jaxslam")
    if name in _HOMES:
        value = getattr(importlib.import_module(f"jaxslam.{_HOMES[name]}"), name)
    elif name in _PACKAGES:
        value = importlib.import_module(f"jaxslam.{name}")
    else:
        raise AttributeError(f"module 'jaxslam' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
