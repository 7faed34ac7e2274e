"""Multinomial resampling: N independent draws."""

from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxslam.resampling._fixed_point import pick_at_random
from jaxslam.resampling._selection import select_ancestors
from jaxslam.resampling.base import AbstractResampler


class MultinomialResampler(AbstractResampler):
    """N independent draws from the weights: the textbook scheme, with the highest variance.

    References:
        Gordon, Salmond, Smith 1993.
    """

    def ancestors(self, key: PRNGKeyArray, log_weights: Float[Array, "N"]) -> Int[Array, "N"]:
        """Return indices `[N]` (int32), in no order; see `AbstractResampler.ancestors`."""
        return select_ancestors(log_weights, lambda weights: pick_at_random(key, weights))
