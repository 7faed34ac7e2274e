"""Memory available to this process and to a device."""

import math
import os
from pathlib import Path

import jax

_LIMIT = Path("/sys/fs/cgroup/memory.max")
"""File with the memory limit of a Linux container, in bytes."""


def physical_memory() -> float:
    """Return the main memory available to this process in bytes; infinite if unknown."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PHYS_PAGES" not in names:
        return math.inf
    installed = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    return min(installed, _container_limit())


def memory_of(device: jax.Device) -> float:
    """Return the device memory available to JAX in bytes; infinite if unknown."""
    return float((device.memory_stats() or {}).get("bytes_limit", math.inf))


def _container_limit() -> float:
    try:
        text = _LIMIT.read_text().strip()
    except OSError:
        return math.inf
    return float(text) if text.isdigit() else math.inf
