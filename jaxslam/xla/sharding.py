"""Sharding of one filter's particles over several devices; each device stores the maps of its particles."""

import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

Tree = TypeVar("Tree")
PARTICLES = "particles"
"""Name of the mesh axis."""


def cores() -> set[int]:
    """Return the indices of the CPU cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def particle_mesh(num_particles: int, devices: Sequence[jax.Device]) -> Mesh | None:
    """Return a mesh that divides the particles equally over devices; None for a single device.

    Raises:
        ValueError: there is no device, or the particles cannot be divided equally.
    """
    if not devices:
        raise ValueError("no devices to shard the particles over: give at least one")
    if num_particles % len(devices):
        raise ValueError(
            f"{num_particles} particles cannot be divided equally over {len(devices)} devices: "
            f"use {-(-num_particles // len(devices)) * len(devices)}"
        )
    # Automatic axes, because explicit ones forbid indexing by a traced value.
    return Mesh(np.array(devices), (PARTICLES,), axis_types=(AxisType.Auto,)) if len(devices) > 1 else None


def with_sharding(mesh: Mesh | None, tree: Tree, num_particles: int) -> Tree:
    """Shard arrays whose first axis is the particles, `[N, …]`; replicate the others on every device."""
    if mesh is None:
        return tree

    def place(leaf: jax.Array) -> jax.Array:
        by_particle = leaf.ndim > 0 and leaf.shape[0] == num_particles
        spec = PartitionSpec(PARTICLES) if by_particle else PartitionSpec()
        return jax.lax.with_sharding_constraint(leaf, NamedSharding(mesh, spec))

    return jax.tree.map(place, tree)


def shard_map(
    mesh: Mesh | None, function: Callable[..., Any], by_particle: Sequence[bool]
) -> Callable[..., Any]:
    """Wrap `function` so that every device calls it with its own particles.

    Without this, XLA shards a loop over particles by sending all maps to all devices at every step.

    Args:
        mesh: the devices; with None, `function` is returned unchanged.
        function: takes arrays; the first axis of its result is the particles.
        by_particle: whether the first axis of each argument is the particles; other arguments are replicated.
    """
    if mesh is None:
        return function
    specs = tuple(PartitionSpec(PARTICLES) if each else PartitionSpec() for each in by_particle)
    return jax.shard_map(
        function, mesh=mesh, in_specs=specs, out_specs=PartitionSpec(PARTICLES), check_vma=False
    )
