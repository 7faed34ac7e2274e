"""How much memory there is."""

import math
import os
from pathlib import Path

import jax

_LIMIT = Path("/sys/fs/cgroup/memory.max")
"""What a container may use, on Linux."""


def physical_memory() -> float:
    """Bytes of main memory that this process may use; infinite where the system does not tell."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PHYS_PAGES" not in names:
        return math.inf
    installed = float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    return min(installed, _container_limit())


def memory_of(device: jax.Device) -> float:
    """Bytes that JAX may use of a device's own memory; infinite where it does not tell."""
    return float((device.memory_stats() or {}).get("bytes_limit", math.inf))


def _container_limit() -> float:
    try:
        text = _LIMIT.read_text().strip()
    except OSError:
        return math.inf
    return float(text) if text.isdigit() else math.inf
