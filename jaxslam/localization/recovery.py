"""Augmented Monte-Carlo localization: random particles when scans fit worse than before."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.core.types import Scalar
from jaxslam.core.validation import require_at_least_zero


class Averages(eqx.Module):
    """Two running averages of the scans' mean likelihood.

    Attributes:
        slow: average over many updates.
        fast: average over few updates.
        slow_weight: total weight of the data in `slow`, 0 to 1.
        fast_weight: total weight of the data in `fast`, 0 to 1.
    """

    slow: Float[Array, ""]
    fast: Float[Array, ""]
    slow_weight: Float[Array, ""]
    fast_weight: Float[Array, ""]

    @classmethod
    def none(cls) -> "Averages":
        """Return the averages before the first scan."""
        zero = jnp.zeros((), jnp.float32)
        return cls(zero, zero, zero, zero)


class Recovery(eqx.Module):
    r"""Share of random particles: $\max(0,\ 1 - w_{fast} / (\nu\, w_{slow}))$.

    The slow average starts at 0 in the book, and would need 1/α updates to become meaningful. Both averages
    are therefore divided by the total weight of their data, so that they start as plain means.

    The likelihood is that of a single beam: products over many beams differ by powers of ten between scans,
    and the averages would follow the largest value.

    Two rules extend the book. While the scan does not match the map, the slow average is not updated:
    otherwise it would fall to the likelihood of wrong poses, and random particles would stop before the robot
    is found. While the particles agree on a pose where the scan does not match, a fixed share is random.

    Attributes:
        slow: α_slow, weight of a new scan in the slow average; 0 disables the recovery.
        fast: α_fast, weight of a new scan in the fast average, > `slow`.
        drop: ν, share of the slow average below which the fast one must fall, so that a poorly mapped room
            does not count as a kidnapping. The book has 1.
        lost_share: share of random particles while the particles agree on a pose at which the scan does not
            match the map.

    References:
        Thrun, Burgard, Fox 2005, table 8.3.
    """

    slow: Scalar = 0.01
    fast: Scalar = 0.2
    drop: Scalar = 0.85
    lost_share: Scalar = 0.3

    def __check_init__(self):
        require_at_least_zero(self, positive=("drop",))
        slow, fast = self.slow, self.fast
        if isinstance(slow, float) and isinstance(fast, float) and not (slow == 0 or slow < fast <= 1):
            raise ValueError(f"recovery.slow is {slow} and recovery.fast {fast}: give slow < fast ≤ 1")

    def update(
        self, averages: Averages, log_likelihood: Float[Array, ""], misfit: Bool[Array, ""]
    ) -> Averages:
        """Return the averages after a scan; `misfit`: the scan does not match the map at the estimate.

        `log_likelihood` is the natural log of the scan's mean likelihood over the particles, per beam. It is
        −inf if the scan fits no particle. A NaN leaves the averages unchanged.
        """
        likelihood = jnp.exp(log_likelihood)
        finite = jnp.isfinite(likelihood)
        slow = jnp.where(finite & ~misfit, self.slow, 0.0)
        fast = jnp.where(finite, self.fast, 0.0)
        likelihood = jnp.where(finite, likelihood, 0.0)
        return Averages(
            slow=averages.slow + slow * (likelihood - averages.slow),
            fast=averages.fast + fast * (likelihood - averages.fast),
            slow_weight=averages.slow_weight + slow * (1.0 - averages.slow_weight),
            fast_weight=averages.fast_weight + fast * (1.0 - averages.fast_weight),
        )

    def share(self, averages: Averages, lost: Bool[Array, ""]) -> Float[Array, ""]:
        """Return the share of random particles, 0 to 1; table 8.3, line 13, and `lost_share` if `lost`."""
        slow = averages.slow / jnp.maximum(averages.slow_weight, 1e-12)
        fast = averages.fast / jnp.maximum(averages.fast_weight, 1e-12)
        known = (averages.slow_weight > 0.0) & (slow > 0.0)
        ratio = fast / jnp.maximum(self.drop * slow, 1e-30)
        share = jnp.where(known, jnp.clip(1.0 - ratio, 0.0, 1.0), 0.0)
        forced = jnp.where(lost & (self.slow > 0.0), self.lost_share, 0.0)
        return jnp.maximum(share, forced).astype(jnp.float32)
