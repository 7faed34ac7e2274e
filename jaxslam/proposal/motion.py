"""The traditional proposal: the motion model alone."""

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult


class MotionProposal(AbstractProposal):
    """q = p(x | x_prev, u), weighted by the likelihood of the scan (the baseline of all three papers)."""

    def sample(self, key: PRNGKeyArray, pose: Float[Array, "3"], context: ProposalContext) -> ProposalResult:
        """Draw from the motion model without regard to the scan."""
        moved = context.motion.sample(key, pose, context.odometry)
        return ProposalResult(
            pose=moved,
            log_likelihood=context.log_likelihood(moved),
            log_ratio=jnp.zeros((), jnp.float32),
            flags=jnp.zeros((), jnp.int32),
        )
