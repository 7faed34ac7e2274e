"""A network from measured to true range: one input, a hidden layer of tanh neurons, one output."""

import io
import json
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.types import LidarScan, StepInputs

_STEEPEST = 4.0
"""Largest input weight of a new neuron. The weight that many neurons call for would let each neuron learn the
readings at one distance only."""
_NUM_FITTED, _SMALLEST = 200, 1e-5
"""Number of points at which a new network is fitted to the identity, and the smallest singular value used for
the fit, relative to the largest. Smaller values would give large weights that cancel each other."""

_FORMAT, _VERSION = "jaxslam range network", 1
_MAX_NEURONS = 100_000


class RangeNetwork(eqx.Module):
    """Correction of ranges. Inputs and outputs are in meters; the network normalizes them internally.

    Beyond the trained interval, the correction at the nearer end of the interval is used, because tanh
    neurons do not extrapolate.

    Attributes:
        weights_in: `[H]` from the input to the hidden layer.
        biases: `[H]` of the hidden layer.
        weights_out: `[H]` from the hidden layer to the output.
        bias_out: of the output.
        shortest: start of the trained interval, meters.
        longest: end of the trained interval, meters.

    References:
        Jamaludin et al.: 50 tanh neurons, a linear output.
    """

    weights_in: Float[Array, "H"]
    biases: Float[Array, "H"]
    weights_out: Float[Array, "H"]
    bias_out: Float[Array, ""]
    shortest: Float[Array, ""]
    longest: Float[Array, ""]

    @classmethod
    def draw(cls, key: PRNGKeyArray, num_neurons: int, shortest: float, longest: float) -> "RangeNetwork":
        """Draw an untrained network that leaves ranges unchanged.

        Neurons switch at points spread evenly over the interval, with steepnesses that make neighbors overlap
        (Nguyen and Widrow 1990): if all switch at one point, training ends early. In large networks they are
        less steep than in the source, because the network would otherwise start as a staircase.
        It has `num_neurons` ≥ 1 and is for readings from `shortest` to `longest`, meters.
        """
        if num_neurons < 1:
            raise ValueError(f"num_neurons is {num_neurons}: give 1 or more")
        if not longest > shortest:
            raise ValueError(f"ranges from {shortest} to {longest} m: give a longest above the shortest")
        key_where, key_steep = jax.random.split(key)
        steepness = 0.7 * num_neurons * jax.random.uniform(key_steep, (num_neurons,), jnp.float32, 0.5, 1.0)
        steepness = jnp.clip(steepness, 1.0, _STEEPEST)
        jitter = jax.random.uniform(key_where, (num_neurons,), jnp.float32, -0.5, 0.5)
        where = 2.0 * (jnp.arange(num_neurons, dtype=jnp.float32) + 0.5 + jitter) / num_neurons - 1.0
        biases = -steepness * where
        # The network starts as the identity. Training changes it no more than necessary, so that it stays
        # smooth between few distances.
        inputs = jnp.linspace(-1.0, 1.0, _NUM_FITTED, dtype=jnp.float32)
        hidden = jnp.tanh(jnp.outer(inputs, steepness) + biases[None])
        terms = jnp.concatenate([hidden, jnp.ones((_NUM_FITTED, 1), jnp.float32)], axis=1)
        outputs = jnp.linalg.lstsq(terms, inputs, rcond=_SMALLEST)[0]
        return cls(
            weights_in=steepness,
            biases=biases,
            weights_out=outputs[:-1],
            bias_out=outputs[-1],
            shortest=jnp.asarray(shortest, jnp.float32),
            longest=jnp.asarray(longest, jnp.float32),
        )

    @property
    def num_neurons(self) -> int:
        """Return the number of neurons H of the hidden layer."""
        return self.weights_in.shape[0]

    def __call__(self, ranges: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Return corrected ranges, meters."""
        half = 0.5 * (self.longest - self.shortest)
        held = jnp.clip(ranges, self.shortest, self.longest)
        normalized = jnp.vectorize(self._output)((held - self.shortest) / half - 1.0)
        corrected = (normalized + 1.0) * half + self.shortest
        return ranges + (corrected - held)

    def _output(self, normalized: Float[Array, ""]) -> Float[Array, ""]:
        """Return the output of the layers; −1 to 1 spans the interval, as for the input."""
        return jnp.tanh(normalized * self.weights_in + self.biases) @ self.weights_out + self.bias_out

    def correct(self, scan: LidarScan) -> LidarScan:
        """Return the scan with corrected ranges; a beam without a return stays unchanged."""
        corrected = jnp.maximum(self(scan.ranges), 0.0)
        return eqx.tree_at(lambda s: s.ranges, scan, jnp.where(scan.valid, corrected, scan.ranges))


def with_corrected_ranges(network: RangeNetwork | None, inputs: StepInputs) -> StepInputs:
    """Return the inputs of a step with the network, if any, applied to the scan."""
    if network is None:
        return inputs
    return eqx.tree_at(lambda i: i.scan, inputs, network.correct(inputs.scan))


def save_network(path: Path, network: RangeNetwork) -> None:
    """Write a network, to be loaded with `load_network`."""
    header = {"format": _FORMAT, "version": _VERSION, "neurons": network.num_neurons}
    with path.open("wb") as stream:
        stream.write(json.dumps(header).encode("ascii") + b"\n")
        eqx.tree_serialise_leaves(stream, network)


def load_network(path: Path) -> RangeNetwork:
    """Read a network.

    Raises:
        ValueError: the file is not a network, is of another version, or is damaged.
        OSError: the file cannot be read.
    """
    content = path.read_bytes()
    first, _, rest = content.partition(b"\n")
    try:
        header = json.loads(first)
    except ValueError:
        header = None
    if not isinstance(header, dict) or header.get("format") != _FORMAT:
        raise ValueError(f"{path}: not a range network; `jaxslam train-range` writes one")
    if header.get("version") != _VERSION:
        raise ValueError(
            f"{path}: range network of version {header.get('version')}, but this release reads version "
            f"{_VERSION}: train it again with `jaxslam train-range`"
        )
    count = header.get("neurons")
    if not (isinstance(count, int) and 1 <= count <= _MAX_NEURONS):
        raise ValueError(f"{path}: number of neurons in the header is {count!r}: the file is damaged")
    shapes = jax.eval_shape(lambda: RangeNetwork.draw(jax.random.key(0), count, 0.0, 1.0))
    stream = io.BytesIO(rest)
    try:
        network = eqx.tree_deserialise_leaves(stream, shapes)
    except (RuntimeError, ValueError, EOFError, OSError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(
            f"{path}: damaged, or not of {count} neurons as stated in its header ({reason})"
        ) from error
    if stream.read(1):
        raise ValueError(f"{path}: longer than the {count} neurons of its header: the file is damaged")
    if not all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(network)):
        raise ValueError(f"{path}: a parameter is not finite: train the network again")
    return network
