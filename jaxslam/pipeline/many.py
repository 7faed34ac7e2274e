"""A filter run many times at once: over keys and over values of its settings, in one compilation."""

import dataclasses
import functools
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Bool, Float, Float32, Int, Int8, Key

from jaxslam.config.dotted import flatten, update
from jaxslam.core.flags import Flag
from jaxslam.core.types import StepInputs
from jaxslam.grid.field import window_rows
from jaxslam.pipeline.chunks import pad_inputs, run_steps
from jaxslam.pipeline.inputs import PreparedScans
from jaxslam.slam.rbpf import RBPF, trajectory
from jaxslam.xla.compiler import compiler_options
from jaxslam.xla.resources import memory_of, physical_memory

_BYTES_PER_WINDOW_CELL = 5
"""Working memory of a step, per particle and cell of its window."""
_BYTES_PER_INFO = 24
"""What a step leaves behind, per particle."""
_COPIES = 3
"""Of the maps where runs are vmapped: as they were, with the scan, and resampled."""
VMAPPED = 16
"""Runs that are vmapped on a device that is no CPU, unless the caller says otherwise."""


@dataclass(frozen=True)
class ManyResult:
    """What `C × S` runs leave behind: `C` configurations, `S` keys. `T` is the longest input's length.

    Attributes:
        trajectories: `[C, S, T, 3]` poses of the best particle (m, m, rad); NaN after an input's end.
        ess: `[C, S, T]` effective sample size before resampling.
        resampled: `[C, S, T]` where it was resampled.
        flags: `[C, S, T]` `jaxslam.core.flags.Flag` bits.
        log_odds: `[C, S, H, W]` map of the best particle, fixed point; None where none was asked for.
        compile_s: seconds spent compiling; next to none if runs of the same sizes have been before.
        run_s: seconds spent running, compilation apart.
        scans_per_s: processed scans of all runs per second of `run_s`.
        ms_per_scan: milliseconds per scan of one run, with as many others beside it as were laid out.
    """

    trajectories: Float32[np.ndarray, "C S T 3"]
    ess: Float32[np.ndarray, "C S T"]
    resampled: Bool[np.ndarray, "C S T"]
    flags: Int[np.ndarray, "C S T"]
    log_odds: Int8[np.ndarray, "C S H W"] | None
    compile_s: float
    run_s: float
    scans_per_s: float
    ms_per_scan: float

    @property
    def left_map(self) -> Bool[np.ndarray, "C S"]:
        """Runs in which a particle reached the edge of its map: `run_log` would have broken them off."""
        return np.any(self.flags & Flag.OFF_MAP.value, axis=-1)

    def __repr__(self) -> str:
        count, seeds, total, _ = self.trajectories.shape
        return (
            f"ManyResult({count} configurations × {seeds} keys × {total} scans, "
            f"{self.scans_per_s:.0f} scans per second)"
        )


def run_many(
    slam: RBPF,
    scans: PreparedScans | Sequence[PreparedScans],
    keys: Key[Array, "S"],
    configs: Mapping[str, Any] | Sequence[RBPF] | None = None,
    *,
    maps: bool = False,
    together: int | None = None,
    devices: Sequence[jax.Device] | None = None,
    progress: bool = False,
) -> ManyResult:
    """Runs a filter with every key and every configuration; all share one program.

    On a CPU one run after the other is the fastest way for one device (README, "Many runs", has the
    figures): under `vmap` a branch takes both of its sides, and the maps are copied at every step.
    What helps is another device: after `jax.config.update("jax_num_cpu_devices", 2)`, before JAX does
    anything else, there are two on two cores, and the runs are spread over them.

    Args:
        slam: the filter, its maps sized for the scans.
        scans: what all runs process; or one for each key, as simulations of several seeds are.
        keys: `[S]` PRNG keys; the same key gives the run of `run_log`, but for rounding.
        configs: `C` values by dotted name, `{"sensor.sigma_hit": [0.05, 0.1]}`: all lists are of one
            length, and the c-th configuration has the c-th of each. Or `C` filters, which differ from each
            other in traced numbers only. None: `slam` alone.
        maps: keep the best particle's map of every run.
        together: how many runs are vmapped on a device. None: 1 on a CPU, 16 on others.
        devices: to spread the runs over; None takes all of the default backend, of a CPU as many as there
            is memory for.
        progress: show a progress bar on stderr (needs tqdm).

    Raises:
        ValueError: a name that no setting has, or one of a size or a choice, on which the program depends;
            lists of different length; a value out of range; no device; more memory than there is.

    Example:
        64 configurations and 10 keys are 640 runs: `trajectories` is `[64, 10, T, 3]`.
    """
    filters = _filters(slam, configs)
    inputs = [scans] if isinstance(scans, PreparedScans) else list(scans)
    if len(keys) == 0 or len(inputs) not in (1, len(keys)):
        raise ValueError(f"{len(keys)} keys and {len(inputs)} inputs: give one input, or one for each key")
    if slam.mesh is not None:
        raise ValueError("the particles are spread over devices already: give run_many a filter on one")
    used = tuple(jax.devices() if devices is None else devices)
    if not used or (together is not None and together < 1):
        raise ValueError(f"{len(used)} devices, {together} runs together: give one or more of each")
    together = together or (1 if used[0].platform == "cpu" else VMAPPED)
    over = _inputs(inputs)
    room = over.inputs.scan.ranges.shape[1]
    kept_maps = len(filters) * len(keys) if maps else 0
    if devices is None:
        used = _that_fit(slam, room, together, used, kept_maps)
    _check_memory(slam, room, together, used, kept_maps)

    program = _program(used, together, room, maps)
    # In NumPy: to pick the rows of a call from JAX's arrays takes longer than a short run. And Python's
    # floats would be weakly typed, and compile a second program.
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

    # However many runs there are, a call takes as many: another number compiles nothing.
    calls = _calls(len(filters), len(keys), len(used) * together)
    started = time.perf_counter()
    # No step at all: what takes time is compiling, unless runs of the same sizes have been before.
    call(calls[0], dataclasses.replace(over, lengths=jnp.zeros_like(over.lengths)))
    compile_s = time.perf_counter() - started
    started = time.perf_counter()
    outcomes = [call(rows, over) for rows in _with_progress(calls, progress)]
    run_s = time.perf_counter() - started
    return _result(outcomes, np.broadcast_to(over.lengths, len(keys)), len(filters), compile_s, run_s)


def _calls(num_configs: int, num_keys: int, per_call: int) -> Int[np.ndarray, "n R 2"]:
    """Configuration and key of every run, so many to a call; the last one's free places repeat the first."""
    table = np.stack(np.meshgrid(np.arange(num_configs), np.arange(num_keys), indexing="ij"), axis=-1)
    num_calls = -(-num_configs * num_keys // per_call)
    return np.resize(table.reshape(-1, 2), (num_calls, per_call, 2))


def _result(
    outcomes: "Sequence[_Outcome]",
    lengths: Int[np.ndarray, "S"],
    num_configs: int,
    compile_s: float,
    run_s: float,
) -> ManyResult:
    """What the calls left behind, by configuration and key, cut to the longest input."""
    num_keys, longest = len(lengths), int(lengths.max())
    outcome = jax.tree.map(lambda *parts: np.concatenate(parts)[: num_configs * num_keys], *outcomes)
    outcome = jax.tree.map(lambda rows: rows.reshape(num_configs, num_keys, *rows.shape[1:]), outcome)
    ended = np.arange(longest) >= lengths[:, None]
    return ManyResult(
        trajectories=np.where(ended[None, :, :, None], np.float32(np.nan), outcome.path[:, :, :longest]),
        ess=outcome.ess[:, :, :longest],
        resampled=outcome.resampled[:, :, :longest],
        flags=outcome.flags[:, :, :longest],
        log_odds=outcome.log_odds,
        compile_s=compile_s,
        run_s=run_s,
        scans_per_s=num_configs * float(lengths.sum()) / run_s,
        ms_per_scan=1e3 * run_s / (len(outcomes) * float(lengths.mean())),
    )


class _Runs(eqx.Module):
    """Runs, stacked: the filter, the key, and which of the inputs."""

    slam: RBPF
    key: Key[Array, "*R"]
    which: Int[Array, "*R"]


class _Inputs(eqx.Module):
    """All inputs, stacked, lengthened to one length; `lengths` says how long each is."""

    inputs: StepInputs
    pose0: Float[Array, "I 3"]
    lengths: Int[Array, "I"]


class _Outcome(eqx.Module):
    """What is kept of a run, as in `ManyResult`."""

    path: Float[Array, "*R T 3"]
    ess: Float[Array, "*R T"]
    resampled: Bool[Array, "*R T"]
    flags: Int[Array, "*R T"]
    log_odds: Int8[Array, "*R H W"] | None


@functools.cache
def _program(
    devices: tuple[jax.Device, ...], together: int, room: int, maps: bool
) -> Callable[[_Runs, _Inputs], _Outcome]:
    """All runs of a call, spread over the devices, on each one after the other or vmapped."""

    def one(run: _Runs, over: _Inputs) -> _Outcome:
        inputs, pose0, count = jax.tree.map(
            lambda leaf: leaf[run.which], (over.inputs, over.pose0, over.lengths)
        )
        state = run.slam.init(run.key, pose0)
        state, infos = run_steps(run.slam, inputs, run.key, state, count=count, length=room)
        best = jnp.argmax(state.log_weights)
        # Behind the end every particle is its own ancestor.
        slots = jnp.arange(run.slam.num_particles, dtype=jnp.int32)
        ancestors = jnp.where((jnp.arange(room) < count)[:, None], infos.ancestors, slots[None])
        path = trajectory(eqx.tree_at(lambda i: i.ancestors, infos, ancestors), best)
        return _Outcome(path, infos.ess, infos.resampled, infos.flags, state.maps[best] if maps else None)

    def local(runs: _Runs, over: _Inputs) -> _Outcome:
        # A batch of one is no batch: `vmap` would turn its branches into selects.
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
    """One filter for each configuration; all of one structure."""
    if configs is None:
        return [slam]
    if isinstance(configs, Mapping):
        values = {name: np.atleast_1d(np.asarray(given)).tolist() for name, given in configs.items()}
        sizes = {name: len(given) for name, given in values.items()}
        if len(set(sizes.values())) > 1:
            raise ValueError(
                f"configurations of different number: {sizes}: give every setting one value for each"
            )
        rows = [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]
        filters = [update(slam, row) for row in (rows if values else [{}])]
    else:
        filters = list(configs)
    if not filters:
        raise ValueError("no configuration was given: give None for the filter as it is")
    for index, other in enumerate(filters):
        if _structure(other) != _structure(slam):
            raise ValueError(f"configuration {index} needs a program of its own: {_difference(slam, other)}")
    return filters


def _difference(one: RBPF, other: RBPF) -> str:
    """Which settings make two filters two programs."""
    before, after = flatten(one), flatten(other)
    changed = {name: after[name] for name in before if name in after and after[name] != before[name]}
    static = [
        name
        for name, value in changed.items()
        if _structure(update(one, {name: value}, exact=True)) != _structure(one)
    ]
    return f"{', '.join(static) or 'a part of it'} is a size or a choice: call run_many once for each value"


def _structure(slam: RBPF) -> Any:
    """All but the traced numbers: what decides the program."""
    return jax.tree.structure(slam)


def _inputs(inputs: Sequence[PreparedScans]) -> _Inputs:
    """The inputs behind each other, all as long as the longest."""
    shapes = {each.inputs.scan.ranges.shape[1] for each in inputs}
    if len(shapes) > 1:
        raise ValueError(
            f"all inputs must have the same number of beams, got {' and '.join(map(str, sorted(shapes)))}"
        )
    longest = max((each.inputs for each in inputs), key=lambda each: len(each.scan.ranges))
    room = len(pad_inputs(longest).scan.ranges)
    lengthened = [
        jax.tree.map(
            lambda leaf: np.pad(leaf, [(0, room - len(leaf))] + [(0, 0)] * (leaf.ndim - 1)), each.inputs
        )
        for each in inputs
    ]
    return _Inputs(
        inputs=jax.tree.map(lambda *leaves: jnp.stack(leaves), *lengthened),
        pose0=jnp.asarray(np.stack([each.pose0 for each in inputs]), jnp.float32),
        lengths=jnp.asarray([len(each.stamps) for each in inputs], jnp.int32),
    )


def bytes_needed(slam: RBPF, num_steps: int, *, together: int, num_devices: int, kept_maps: int) -> float:
    """An estimate of the memory that `run_many` takes beyond what the process has already.

    Args:
        slam: the filter.
        num_steps: of the longest input, lengthened to a power of two.
        together: runs that are vmapped on a device.
        num_devices: which share one memory, as those of a CPU do.
        kept_maps: maps that are kept for the result.

    Example:
        30 maps of 1200 × 1000 cells and a window of 336² cells: 36 + 17 MB for a run alone, and
        3 · 36 + 17 MB for each of several that are vmapped.
    """
    cells = slam.grid.height * slam.grid.width
    window = window_rows(slam.window_size, slam.radius) * slam.window_size
    copies = _COPIES if together > 1 else 1
    particle = copies * cells + _BYTES_PER_WINDOW_CELL * window + _BYTES_PER_INFO * num_steps
    return float(num_devices * together * slam.num_particles * particle + kept_maps * cells)


def _that_fit(
    slam: RBPF, num_steps: int, together: int, devices: tuple[jax.Device, ...], kept_maps: int
) -> tuple[jax.Device, ...]:
    """So many of the devices as their memory is enough for, at least one."""
    if devices[0].platform != "cpu":
        return devices
    alone, both = (
        bytes_needed(slam, num_steps, together=together, num_devices=count, kept_maps=kept_maps)
        for count in (1, 2)
    )
    spare = physical_memory() - alone
    return devices[: 1 + int(min(max(spare / (both - alone), 0.0), len(devices)))]


def _check_memory(
    slam: RBPF, num_steps: int, together: int, devices: tuple[jax.Device, ...], kept_maps: int
) -> None:
    # Those of a CPU share its memory, others have some of their own.
    own = devices[0].platform != "cpu"
    num_devices = 1 if own else len(devices)
    needed = bytes_needed(
        slam, num_steps, together=together, num_devices=num_devices, kept_maps=0 if own else kept_maps
    )
    available = memory_of(devices[0]) if own else physical_memory()
    if needed > available:
        height, width = slam.grid.height, slam.grid.width
        raise ValueError(
            f"{num_devices * together} runs at once of {slam.num_particles} maps of {height} × {width} "
            f"cells, and {kept_maps} maps kept, need {needed / 1e9:.3g} GB of the {available / 1e9:.3g} GB "
            "there are: lower `together` or the number of devices, keep no maps, or take fewer particles"
        )


def _with_progress(calls: Int[np.ndarray, "n R 2"], progress: bool) -> Iterable[Int[np.ndarray, "R 2"]]:
    if not progress:
        return calls
    from tqdm import tqdm

    return tqdm(calls, unit="call", desc=f"{calls.shape[1]} runs a call", dynamic_ncols=True)
