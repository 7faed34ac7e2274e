"""Proposals: distributions from which a filter draws the next poses of its particles."""

from jaxslam.proposal.base import AbstractProposal, ProposalContext, ProposalResult
from jaxslam.proposal.fruit_fly import FruitFlyProposal
from jaxslam.proposal.gaussian import GaussianProposal
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.proposal.motion import MotionProposal

__all__ = [
    "AbstractProposal",
    "FruitFlyProposal",
    "GaussianProposal",
    "MatchedProposal",
    "MotionProposal",
    "ProposalContext",
    "ProposalResult",
]
