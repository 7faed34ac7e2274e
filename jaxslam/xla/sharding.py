"""Sharding the particles of one filter over several devices; each device keeps its particles' maps."""

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
    """Return a mesh of devices with equal numbers of particles; None for one device, which needs no mesh.

    Raises:
        ValueError: there is no device, or the particles cannot be divided equally among the devices.
    """
    if not devices:
        raise ValueError("no device to distribute the particles over: give one or more")
    if num_particles % len(devices):
        raise ValueError(
            f"{num_particles} particles cannot be divided equally among {len(devices)} devices: "
            f"give {-(-num_particles // len(devices)) * len(devices)}"
        )
    # An automatic axis: with an explicit one, indexing by a traced value is an error.
    return Mesh(np.array(devices), (PARTICLES,), axis_types=(AxisType.Auto,)) if len(devices) > 1 else None


def with_sharding(mesh: Mesh | None, tree: Tree, num_particles: int) -> Tree:
    """Return the same arrays, with each array `[N, …]` (particles first) sharded over the devices."""
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
    """Return `function` wrapped so that every device calls it on its own particles.

    Left to itself, XLA would run a loop over particles by sending all maps to all devices at every step.

    Args:
        mesh: the devices; None returns `function` unchanged.
        function: a function of arrays whose result has the particles as its first axis.
        by_particle: whether each argument has the particles as its first axis; the other arguments are
            replicated on every device.
    """
    if mesh is None:
        return function
    specs = tuple(PartitionSpec(PARTICLES) if each else PartitionSpec() for each in by_particle)
    return jax.shard_map(
        function, mesh=mesh, in_specs=specs, out_specs=PartitionSpec(PARTICLES), check_vma=False
    )
