"""The contract of a resampling scheme."""

import abc

import equinox as eqx
from jaxtyping import Array, Float, Int, PRNGKeyArray


class AbstractResampler(eqx.Module):
    """A scheme that chooses ancestors in proportion to the weights."""

    @abc.abstractmethod
    def ancestors(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Int[Array, "N"]:
        """Return indices `[N]` (int32) of the particles that continue; unbiased: E[count of i] = N · w_i.

        Args:
            key: PRNG key.
            log_weights: `[N]` natural log, need not be normalized; −inf is a particle that cannot continue.
        """
