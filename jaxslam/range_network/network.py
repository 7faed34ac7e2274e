"""One input, a hidden layer of tanh neurons, one output: from a range read to the range that is true."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.core.types import LidarScan, StepInputs

_STEEPEST = 4.0
"""Steps of a new neuron over half the interval: as steep as many neurons would have it, each would learn the
readings at one distance and nothing in between."""
_NUM_FITTED, _SMALLEST = 200, 1e-5
"""Points at which a new network is made to correct nothing, and the smallest singular value used for it, as a
share of the largest: smaller ones would make large weights that cancel each other."""


class RangeNetwork(eqx.Module):
    """Corrects ranges. Normalization is inside: in and out are meters.

    Beyond the interval that it was trained on the correction of the interval's end is held: what tanh
    neurons say there is made up.

    Attributes:
        weights_in: `[H]` from the input to the hidden layer.
        biases: `[H]` of the hidden layer.
        weights_out: `[H]` from it to the output.
        bias_out: of the output.
        shortest: trained interval, meters.
        longest: its end, meters.

    References:
        The third paper, "ann": 50 tanh neurons, a linear output.
    """

    weights_in: Float[Array, "H"]
    biases: Float[Array, "H"]
    weights_out: Float[Array, "H"]
    bias_out: Float[Array, ""]
    shortest: Float[Array, ""]
    longest: Float[Array, ""]

    @classmethod
    def draw(cls, key: PRNGKeyArray, num_neurons: int, shortest: float, longest: float) -> "RangeNetwork":
        """A network to start training from.

        Neurons switch evenly over the interval, at steepnesses that make neighbors overlap (Nguyen and
        Widrow 1990): with all of them in one place training ends early. Many of them are less steep than
        that, or they begin as a staircase.

        Args:
            key: draws where and how steep.
            num_neurons: H ≥ 1.
            shortest: shortest range of the readings, meters.
            longest: the longest, > `shortest`.
        """
        if num_neurons < 1:
            raise ValueError(f"num_neurons is {num_neurons}: give 1 or more")
        if not longest > shortest:
            raise ValueError(f"ranges from {shortest} to {longest} m: a network needs an interval")
        key_where, key_steep = jax.random.split(key)
        steepness = 0.7 * num_neurons * jax.random.uniform(key_steep, (num_neurons,), jnp.float32, 0.5, 1.0)
        steepness = jnp.clip(steepness, 1.0, _STEEPEST)
        jitter = jax.random.uniform(key_where, (num_neurons,), jnp.float32, -0.5, 0.5)
        where = 2.0 * (jnp.arange(num_neurons, dtype=jnp.float32) + 0.5 + jitter) / num_neurons - 1.0
        biases = -steepness * where
        # It begins as one that corrects nothing. The readings move it no further than they must, so that it
        # stays smooth between few distances.
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
        """H."""
        return self.weights_in.shape[0]

    def __call__(self, ranges: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
        """Corrected ranges, meters."""
        half = 0.5 * (self.longest - self.shortest)
        held = jnp.clip(ranges, self.shortest, self.longest)
        normalized = jnp.vectorize(self._output)((held - self.shortest) / half - 1.0)
        corrected = (normalized + 1.0) * half + self.shortest
        return ranges + (corrected - held)

    def _output(self, normalized: Float[Array, ""]) -> Float[Array, ""]:
        """Of the layers, −1 to 1 over the interval as the input is."""
        return jnp.tanh(normalized * self.weights_in + self.biases) @ self.weights_out + self.bias_out

    def correct(self, scan: LidarScan) -> LidarScan:
        """The scan with its ranges corrected; a beam that returned nothing stays so."""
        corrected = jnp.maximum(self(scan.ranges), 0.0)
        return eqx.tree_at(lambda s: s.ranges, scan, jnp.where(scan.valid, corrected, scan.ranges))


def with_corrected_ranges(network: RangeNetwork | None, inputs: StepInputs) -> StepInputs:
    """A step's inputs with the network applied to its scan, where there is one."""
    if network is None:
        return inputs
    return eqx.tree_at(lambda i: i.scan, inputs, network.correct(inputs.scan))
