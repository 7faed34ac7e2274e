"""Augmented Monte-Carlo localisation: random particles when the scans fit worse than they used to."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxslam.checks import require_at_least_zero


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

    A scan's likelihood is taken to the root of the beams that it counts for: products of many beams differ
    by powers of ten from one scan to the next, and the averages would follow the luckiest.

    Attributes:
        slow: α_slow, weight of a new scan in the slow average; 0 switches the recovery off.
        fast: α_fast, in the fast one, > `slow`.
        root: of the likelihood; 1 is the book's.
        drop: ν, share of the slow average under which the fast one must fall: a room that the map shows badly
            is no kidnapping. 1 is the book's.

    References:
        Thrun, Burgard, Fox, Probabilistic Robotics, table 8.3.
    """

    slow: float | Float[Array, ""] = 0.01
    fast: float | Float[Array, ""] = 0.2
    root: float | Float[Array, ""] = 10.0
    drop: float | Float[Array, ""] = 0.85

    def __check_init__(self):
        require_at_least_zero(self, positive=("root", "drop"))
        slow, fast = self.slow, self.fast
        if isinstance(slow, float) and isinstance(fast, float) and not (slow == 0 or slow < fast <= 1):
            raise ValueError(f"recovery.slow is {slow} and recovery.fast {fast}: give slow < fast ≤ 1")

    def update(self, averages: Averages, likelihood: Float[Array, ""]) -> Averages:
        """The averages after a scan whose mean likelihood over the particles is given."""
        # A scan that nothing fits is data; one that is not a number is none.
        likelihood = jnp.where(jnp.isfinite(likelihood), likelihood, 0.0) ** (1.0 / self.root)
        return Averages(
            slow=averages.slow + self.slow * (likelihood - averages.slow),
            fast=averages.fast + self.fast * (likelihood - averages.fast),
            slow_weight=averages.slow_weight + self.slow * (1.0 - averages.slow_weight),
            fast_weight=averages.fast_weight + self.fast * (1.0 - averages.fast_weight),
        )

    def share(self, averages: Averages) -> Float[Array, ""]:
        """Share of random particles, 0 to 1; table 8.3, line 13."""
        slow = averages.slow / jnp.maximum(averages.slow_weight, 1e-12)
        fast = averages.fast / jnp.maximum(averages.fast_weight, 1e-12)
        known = (averages.slow_weight > 0.0) & (slow > 0.0)
        ratio = fast / jnp.maximum(self.drop * slow, 1e-30)
        return jnp.where(known, jnp.clip(1.0 - ratio, 0.0, 1.0), 0.0)
