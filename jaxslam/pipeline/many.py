"""Run a filter over many keys and many values of its settings, in one compilation."""

import dataclasses
import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Bool, Float, Int, Int8, Key

from jaxslam.config.dotted import flatten, update
from jaxslam.core.names import optional_import
from jaxslam.core.types import StepInputs
from jaxslam.core.validation import require_keys, require_types
from jaxslam.grid.field import window_rows
from jaxslam.pipeline.chunks import pad_inputs, run_steps
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.pipeline.many_result import ManyResult
from jaxslam.pipeline.run import FROM_PREPARE
from jaxslam.slam.rbpf import RBPF, trajectory
from jaxslam.xla.compiler import compiler_options
from jaxslam.xla.resources import memory_of, physical_memory

_BYTES_PER_WINDOW_CELL = 5
"""Working memory of a step, per particle and cell of its window."""
_BYTES_PER_INFO = 24
"""Size of the diagnostics of a step, per particle."""
_COPIES = 3
"""Copies of the maps in vmapped runs: before the scan, after the scan, and resampled."""
VMAPPED = 16
"""Default number of vmapped runs on a device other than a CPU."""


def run_many(
    slam: RBPF,
    scans: PreparedScans | Sequence[PreparedScans],
    keys: Key[Array, "S"],
    configs: Mapping[str, Any] | Sequence[RBPF] | None = None,
    *,
    maps: bool = False,
    truth: Any = None,
    together: int | None = None,
    devices: Sequence[jax.Device] | None = None,
    progress: bool = False,
) -> ManyResult:
    """Run a filter with every key and every configuration; all runs share one program.

    On a single CPU device, sequential runs are fastest (see `docs/guides/many-runs.md`): under `vmap`, both
    sides of every branch are computed and the maps are copied at every step. To use several CPU cores, create
    one device per core with `jax.config.update("jax_num_cpu_devices", 2)` before any other use of JAX. The
    runs are then distributed over the devices.

    Args:
        slam: the filter, with maps sized for the scans.
        scans: scans that all runs process, or one sequence of scans for each key, for example simulations
            with different seeds.
        keys: `[S]` PRNG keys; except for rounding, a key gives the same run as in `run_log`.
        configs: `C` values for each dotted name, for example `{"sensor.sigma_hit": [0.05, 0.1]}`. All lists
            have the same length; configuration c takes element c of each list. Alternatively `C` filters that
            differ in traced numbers only. None runs `slam` alone.
        maps: keep the map of the best particle of every run.
        truth: truth for `ManyResult.errors`, which the table of the result then shows.
        together: number of runs that are vmapped on a device; None for 1 on a CPU and 16 on other devices.
        devices: devices to distribute the runs over; None takes all devices of the default backend, limited
            on a CPU by the available memory.
        progress: show a progress bar on stderr (needs tqdm).

    Raises:
        ValueError: a name is unknown or names a static setting (a size or a choice); the lists differ in
            length; a value is out of range; no device is given; the runs would not fit into memory.

    Example:
        64 configurations and 10 keys are 640 runs: `trajectories` is `[64, 10, T, 3]`.
    """
    inputs = [scans] if isinstance(scans, PreparedScans) else scans
    require_types("run_many", slam=(slam, RBPF, FROM_PREPARE), scans=(inputs, Sequence, FROM_PREPARE))
    require_keys("run_many", keys, 1, "jax.random.split(jax.random.key(0), 8)")
    filters = _filters(slam, configs)
    if len(keys) == 0 or len(inputs) not in (1, len(keys)):
        raise ValueError(f"{len(keys)} keys and {len(inputs)} inputs: give one input, or one for each key")
    if slam.mesh is not None:
        raise ValueError(
            "the particles are already sharded over devices: give run_many a filter on a single device"
        )
    used = tuple(jax.devices() if devices is None else devices)
    if not used or (together is not None and together < 1):
        raise ValueError(f"{len(used)} devices, {together} runs together: give one or more of each")
    together = together or (1 if used[0].platform == "cpu" else VMAPPED)
    over = _inputs(inputs)
    room = over.inputs.scan.ranges.shape[1]
    kept_maps = len(filters) * len(keys) if maps else 0
    used = _devices_in_memory(used, slam, room, together, kept_maps, drop_some=devices is None)
    program = _program(used, together, room, maps)
    # NumPy, because indexing JAX arrays for each call takes longer than a short run, and because Python
    # floats would be weakly typed and compile a second program.
    stacked = jax.tree.map(lambda *leaves: np.stack([np.asarray(leaf) for leaf in leaves]), *filters)
    key_data, kind = np.asarray(jax.random.key_data(keys)), jax.random.key_impl(keys)

    def call(rows: Int[np.ndarray, "R 2"], over: "_Inputs") -> "_Outcome":
        config, index = rows[:, 0], rows[:, 1]
        outcome = program(
            _Runs(
                slam=jax.tree.map(lambda leaf: leaf[config], stacked),
                key=jax.random.wrap_key_data(key_data[index], impl=kind),
                which=jnp.asarray(index if len(inputs) > 1 else np.zeros_like(index), jnp.int32),
            ),
            over,
        )
        return jax.tree.map(np.asarray, outcome)

    # Every call has the same number of runs, so that another total number of runs does not recompile.
    calls = _calls(len(filters), len(keys), len(used) * together)
    started = time.perf_counter()
    # A call with 0 steps only compiles, unless the program was compiled before.
    call(calls[0], dataclasses.replace(over, lengths=jnp.zeros_like(over.lengths)))
    compile_s = time.perf_counter() - started
    started = time.perf_counter()
    outcomes = [call(rows, over) for rows in _with_progress(calls, progress)]
    run_s = time.perf_counter() - started
    rows = [flatten(each) for each in filters]
    values = {name: [row[name] for row in rows] for name in rows[0]}
    return _result(
        outcomes,
        np.broadcast_to(over.lengths, len(keys)),
        run_s,
        scans=tuple(inputs),
        configs={name: given for name, given in values.items() if len(set(given)) > 1},
        grids=tuple(each.grid for each in filters),
        compile_s=compile_s,
        truth=truth,
    )


def _calls(num_configs: int, num_keys: int, per_call: int) -> Int[np.ndarray, "n R 2"]:
    """Distribute all runs (configuration, key) over calls; the first runs fill up the last call."""
    table = np.stack(np.meshgrid(np.arange(num_configs), np.arange(num_keys), indexing="ij"), axis=-1)
    num_calls = -(-num_configs * num_keys // per_call)
    return np.resize(table.reshape(-1, 2), (num_calls, per_call, 2))


def _result(
    outcomes: "Sequence[_Outcome]", lengths: Int[np.ndarray, "S"], run_s: float, **known: Any
) -> ManyResult:
    """Arrange the outcomes of the calls by configuration and key, cut to the longest input."""
    num_configs, num_keys, longest = len(known["grids"]), len(lengths), int(lengths.max())
    outcome = jax.tree.map(lambda *parts: np.concatenate(parts)[: num_configs * num_keys], *outcomes)
    outcome = jax.tree.map(lambda rows: rows.reshape(num_configs, num_keys, *rows.shape[1:]), outcome)
    ended = np.arange(longest) >= lengths[:, None]
    return ManyResult(
        trajectories=np.where(ended[None, :, :, None], np.float32(np.nan), outcome.path[:, :, :longest]),
        ess=outcome.ess[:, :, :longest],
        resampled=outcome.resampled[:, :, :longest],
        flags=outcome.flags[:, :, :longest],
        log_odds=outcome.log_odds,
        run_s=run_s,
        scans_per_s=num_configs * float(lengths.sum()) / run_s,
        ms_per_scan=1e3 * run_s / (len(outcomes) * float(lengths.mean())),
        **known,
    )


class _Runs(eqx.Module):
    """Stacked runs: the filter, the key, and the index of the input."""

    slam: RBPF
    key: Key[Array, "*R"]
    which: Int[Array, "*R"]


class _Inputs(eqx.Module):
    """All inputs, stacked and padded to one length, and their true `lengths`."""

    inputs: StepInputs
    pose0: Float[Array, "I 3"]
    lengths: Int[Array, "I"]


class _Outcome(eqx.Module):
    """The kept part of a run, as in `ManyResult`."""

    path: Float[Array, "*R T 3"]
    ess: Float[Array, "*R T"]
    resampled: Bool[Array, "*R T"]
    flags: Int[Array, "*R T"]
    log_odds: Int8[Array, "*R H W"] | None


@functools.cache
def _program(
    devices: tuple[jax.Device, ...], together: int, room: int, maps: bool
) -> Callable[[_Runs, _Inputs], _Outcome]:
    """Compile the runs of a call: distributed over devices, and sequential or vmapped on each device."""

    def one(run: _Runs, over: _Inputs) -> _Outcome:
        inputs, pose0, count = jax.tree.map(
            lambda leaf: leaf[run.which], (over.inputs, over.pose0, over.lengths)
        )
        state = run.slam.init(run.key, pose0)
        state, infos = run_steps(run.slam, inputs, run.key, state, count=count, length=room)
        best = jnp.argmax(state.log_weights)
        # After the end of an input, every particle is its own ancestor.
        slots = jnp.arange(run.slam.num_particles, dtype=jnp.int32)
        ancestors = jnp.where((jnp.arange(room) < count)[:, None], infos.ancestors, slots[None])
        path = trajectory(eqx.tree_at(lambda i: i.ancestors, infos, ancestors), best)
        return _Outcome(path, infos.ess, infos.resampled, infos.flags, state.maps[best] if maps else None)

    def local(runs: _Runs, over: _Inputs) -> _Outcome:
        # Do not vmap a batch of one, because `vmap` would turn its branches into selects.
        batch_size = together if together > 1 else None
        return jax.lax.map(lambda run: one(run, over), runs, batch_size=batch_size)

    runs_axis = PartitionSpec("runs")
    spread = jax.shard_map(
        local,
        mesh=Mesh(np.array(devices), ("runs",)),
        in_specs=(runs_axis, PartitionSpec()),
        out_specs=runs_axis,
        check_vma=False,
    )
    return jax.jit(spread, compiler_options=compiler_options())


def _filters(slam: RBPF, configs: Mapping[str, Any] | Sequence[RBPF] | None) -> list[RBPF]:
    """Return one filter for each configuration; all have the same structure."""
    if configs is None or configs == {}:
        return [slam]
    if isinstance(configs, Mapping):
        values = {name: np.atleast_1d(given).tolist() for name, given in configs.items()}
        sizes = {name: len(given) for name, given in values.items()}
        if len(set(sizes.values())) > 1:
            raise ValueError(
                f"the settings have different numbers of values, {sizes}: give each the same number"
            )
        rows = zip(*values.values(), strict=True)
        filters = [update(slam, dict(zip(values, row, strict=True))) for row in rows]
    else:
        filters = list(configs)
    if not filters:
        raise ValueError("configs is empty: give None to run the filter as it is")
    # The structure determines the program: it holds everything but the traced numbers.
    program: Any = jax.tree.structure(slam)
    for index, other in enumerate(filters):
        if program != jax.tree.structure(other):
            raise ValueError(
                f"configuration {index} does not share the program of the filter: {_difference(slam, other)}"
            )
    return filters


def _difference(one: RBPF, other: RBPF) -> str:
    """Describe the settings that prevent two filters from sharing a program."""
    before, after, program = flatten(one), flatten(other), jax.tree.structure(one)  # type: Any, Any, Any
    changed = [name for name in before if name in after and after[name] != before[name]]
    updated = {name: update(one, {name: after[name]}, exact=True) for name in changed}
    static = [name for name in changed if program != jax.tree.structure(updated[name])]
    names = ", ".join(static) or "a part of the filter"
    return f"{names} is a size or a choice: call run_many once for each value"


def _inputs(inputs: Sequence[PreparedScans]) -> _Inputs:
    """Stack the inputs, padded to the length of the longest."""
    shapes = {each.inputs.scan.ranges.shape[1] for each in inputs}
    if len(shapes) > 1:
        raise ValueError(
            f"all inputs must have the same number of beams, got {' and '.join(map(str, sorted(shapes)))}"
        )
    lengths = [len(each.stamps) for each in inputs]
    padded = [pad_inputs(each.inputs, max(lengths)) for each in inputs]
    return _Inputs(
        inputs=jax.tree.map(lambda *leaves: jnp.stack(leaves), *padded),
        pose0=jnp.asarray(np.stack([each.pose0 for each in inputs]), jnp.float32),
        lengths=jnp.asarray(lengths, jnp.int32),
    )


def bytes_per_device(slam: RBPF, num_steps: int, together: int) -> float:
    """Estimate the memory of the runs on one device, bytes.

    Args:
        slam: the filter.
        num_steps: number of steps of the longest input, padded to a power of two.
        together: number of runs that are vmapped on the device.

    Example:
        30 maps of 1200 × 1000 cells and a window of 336² cells: 36 + 17 MB for a single run, and
        3 · 36 + 17 MB for each of several vmapped runs.
    """
    copies = _COPIES if together > 1 else 1
    window = window_rows(slam.window_size, slam.radius) * slam.window_size
    particle = copies * slam.grid.height * slam.grid.width
    particle += _BYTES_PER_WINDOW_CELL * window + _BYTES_PER_INFO * num_steps
    return float(together * slam.num_particles * particle)


def _devices_in_memory(
    devices: tuple[jax.Device, ...],
    slam: RBPF,
    num_steps: int,
    together: int,
    kept_maps: int,
    *,
    drop_some: bool,
) -> tuple[jax.Device, ...]:
    """Return the devices; `drop_some` limits those of a CPU to the number that fits into memory.

    Raises:
        ValueError: the runs do not fit into memory.
    """
    # CPU devices share the memory of the host, which also holds the kept maps; others have their own memory.
    on_host = devices[0].platform == "cpu"
    available = physical_memory() if on_host else memory_of(devices[0])
    height, width = slam.grid.height, slam.grid.width
    each, kept = bytes_per_device(slam, num_steps, together), kept_maps * height * width if on_host else 0
    if on_host and drop_some:
        devices = devices[: int(np.clip((available - kept) / each, 1, len(devices)))]
    num_sharing = len(devices) if on_host else 1
    needed = num_sharing * each + kept
    if needed > available:
        raise ValueError(
            f"{num_sharing * together} parallel runs of {slam.num_particles} maps of {height} × {width} "
            f"cells and {kept_maps} kept maps need {needed / 1e9:.3g} GB, but only {available / 1e9:.3g} "
            "GB are available: lower `together`, the number of devices or of particles, or keep no maps"
        )
    return devices


def _with_progress(calls: Int[np.ndarray, "n R 2"], progress: bool) -> Iterable[Int[np.ndarray, "R 2"]]:
    if not progress:
        return calls
    with optional_import():
        from tqdm import tqdm
    return tqdm(calls, unit="call", desc=f"{calls.shape[1]} runs per call", dynamic_ncols=True)
