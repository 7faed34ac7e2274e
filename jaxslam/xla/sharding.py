"""The particles of one filter spread over several devices: each keeps the maps of its own."""

import os
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import jax
import numpy as np
from jax.sharding import AxisType, Mesh, NamedSharding, PartitionSpec

Tree = TypeVar("Tree")
PARTICLES = "particles"
"""Name of the mesh's axis."""


def cores() -> set[int]:
    """The cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


def particle_mesh(num_particles: int, devices: Sequence[jax.Device]) -> Mesh | None:
    """Devices for equal shares of the particles; None for a single one, which needs no mesh.

    Raises:
        ValueError: the particles cannot be shared out equally.
    """
    if not devices:
        raise ValueError("there is no device to spread the particles over: give one or more")
    if num_particles % len(devices):
        raise ValueError(
            f"{num_particles} particles cannot be shared out equally over {len(devices)} devices: "
            f"take {-(-num_particles // len(devices)) * len(devices)}"
        )
    # Of the automatic kind: in an explicit one, looking up by a traced index would be an error.
    return Mesh(np.array(devices), (PARTICLES,), axis_types=(AxisType.Auto,)) if len(devices) > 1 else None


def with_sharding(mesh: Mesh | None, tree: Tree, num_particles: int) -> Tree:
    """The same arrays; those with the particles first, `[N, …]`, on the devices that have them."""
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
    """`function`, called on every device with its own share of the particles.

    XLA would spread a loop over particles by sending all of their maps to all devices at every step.

    Args:
        mesh: the devices; None calls it as it is.
        function: of arrays; its result has the particles first.
        by_particle: which of the arguments have them first; the others are whole on every device.
    """
    if mesh is None:
        return function
    specs = tuple(PartitionSpec(PARTICLES) if each else PartitionSpec() for each in by_particle)
    return jax.shard_map(
        function, mesh=mesh, in_specs=specs, out_specs=PartitionSpec(PARTICLES), check_vma=False
    )
