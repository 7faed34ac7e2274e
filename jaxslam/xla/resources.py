"""Available memory."""

import math
import os
from pathlib import Path

import jax

_LIMIT = Path("/sys/fs/cgroup/memory.max")
"""Memory limit of a container on Linux."""


def physical_memory() -> float:
    """Return the bytes of main memory that this process may use; infinite if they are unknown."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PHYS_PAGES" not in names:
        return math.inf
    installed = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    return min(installed, _container_limit())


def memory_of(device: jax.Device) -> float:
    """Return the bytes of a device's own memory that JAX may use; infinite if they are unknown."""
    return float((device.memory_stats() or {}).get("bytes_limit", math.inf))


def _container_limit() -> float:
    try:
        text = _LIMIT.read_text().strip()
    except OSError:
        return math.inf
    return float(text) if text.isdigit() else math.inf
