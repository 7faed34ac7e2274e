"""Augmented Monte-Carlo localization: random particles when the scans fit worse than they used to."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxslam.core.validation import require_at_least_zero


class Averages(eqx.Module):
    """Two running averages of the scans' mean likelihood.

    Attributes:
        slow: over many updates.
        fast: over few.
        slow_weight: how much of `slow` is data yet, 0 to 1.
        fast_weight: and of `fast`.
    """

    slow: Float[Array, ""]
    fast: Float[Array, ""]
    slow_weight: Float[Array, ""]
    fast_weight: Float[Array, ""]

    @classmethod
    def none(cls) -> "Averages":
        """Before the first scan."""
        zero = jnp.zeros((), jnp.float32)
        return cls(zero, zero, zero, zero)


class Recovery(eqx.Module):
    r"""The share of random particles: $\max(0,\ 1 - w_{fast} / (\nu\, w_{slow}))$.

    Started at 0, as the book has it, the slow average would take 1/α updates to tell anything; both are
    divided by the share of data in them, which makes them the plain mean at first.

    The likelihood is that of one beam: products of many differ by powers of ten from one scan to the next,
    and the averages would follow the luckiest.

    Two things are not the book's. While the scan does not lie on the map, the slow average waits: it would
    come down to what is wrong, and the random particles would stop before the robot is found. And where the
    particles agree on such a place, some are random however long it has been so.

    Attributes:
        slow: α_slow, weight of a new scan in the slow average; 0 switches the recovery off.
        fast: α_fast, in the fast one, > `slow`.
        drop: ν, share of the slow average under which the fast one must fall: a room that the map shows badly
            is no kidnapping. 1 is the book's.
        lost_share: random particles while they agree on a place where the scan does not lie on the map.

    References:
        Thrun, Burgard, Fox, Probabilistic Robotics, table 8.3.
    """

    slow: float | Float[Array, ""] = 0.01
    fast: float | Float[Array, ""] = 0.2
    drop: float | Float[Array, ""] = 0.85
    lost_share: float | Float[Array, ""] = 0.3

    def __check_init__(self):
        require_at_least_zero(self, positive=("drop",))
        slow, fast = self.slow, self.fast
        if isinstance(slow, float) and isinstance(fast, float) and not (slow == 0 or slow < fast <= 1):
            raise ValueError(f"recovery.slow is {slow} and recovery.fast {fast}: give slow < fast ≤ 1")

    def update(
        self, averages: Averages, log_likelihood: Float[Array, ""], misfit: Bool[Array, ""]
    ) -> Averages:
        """The averages after a scan.

        Args:
            averages: before it.
            log_likelihood: natural log of its mean likelihood over the particles, by beam; −inf for a scan
                that nothing fits. A NaN changes nothing.
            misfit: whether it does not lie on the map at the estimate.
        """
        likelihood = jnp.exp(log_likelihood)
        told = jnp.isfinite(likelihood)
        slow = jnp.where(told & ~misfit, self.slow, 0.0)
        fast = jnp.where(told, self.fast, 0.0)
        likelihood = jnp.where(told, likelihood, 0.0)
        return Averages(
            slow=averages.slow + slow * (likelihood - averages.slow),
            fast=averages.fast + fast * (likelihood - averages.fast),
            slow_weight=averages.slow_weight + slow * (1.0 - averages.slow_weight),
            fast_weight=averages.fast_weight + fast * (1.0 - averages.fast_weight),
        )

    def share(self, averages: Averages, lost: Bool[Array, ""]) -> Float[Array, ""]:
        """Share of random particles, 0 to 1; table 8.3, line 13.

        Args:
            averages: of the scans.
            lost: whether the particles agree on a place where the scan does not lie on the map.
        """
        slow = averages.slow / jnp.maximum(averages.slow_weight, 1e-12)
        fast = averages.fast / jnp.maximum(averages.fast_weight, 1e-12)
        known = (averages.slow_weight > 0.0) & (slow > 0.0)
        ratio = fast / jnp.maximum(self.drop * slow, 1e-30)
        share = jnp.where(known, jnp.clip(1.0 - ratio, 0.0, 1.0), 0.0)
        forced = jnp.where(lost & (self.slow > 0.0), self.lost_share, 0.0)
        return jnp.maximum(share, forced).astype(jnp.float32)
