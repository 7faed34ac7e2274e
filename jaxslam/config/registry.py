"""The classes that a configuration can choose from, by name.

Register a new proposal, motion model, sensor model or resampler here with one line.
"""

import equinox as eqx

from jaxslam.motion import (
    AbstractMotionModel,
    GaussianMotion,
    OdometryMotion,
    OmnidirectionalMotion,
    VelocityMotion,
)
from jaxslam.proposal.base import AbstractProposal
from jaxslam.proposal.fruit_fly import FruitFlyProposal
from jaxslam.proposal.gaussian import GaussianProposal
from jaxslam.proposal.matched import MatchedProposal
from jaxslam.proposal.motion import MotionProposal
from jaxslam.resampling import (
    AbstractResampler,
    MultinomialResampler,
    ResidualResampler,
    StratifiedResampler,
    SystematicResampler,
)
from jaxslam.sensor.base import AbstractSensorModel
from jaxslam.sensor.beam import Beam
from jaxslam.sensor.endpoint import Endpoint
from jaxslam.sensor.likelihood_field import LikelihoodField
from jaxslam.sensor.nav2_field import Nav2Field

VARIANTS: dict[type[eqx.Module], dict[str, type[eqx.Module]]] = {
    AbstractMotionModel: {
        "odometry": OdometryMotion,
        "velocity": VelocityMotion,
        "omnidirectional": OmnidirectionalMotion,
        "gaussian": GaussianMotion,
    },
    AbstractSensorModel: {
        "likelihood_field": LikelihoodField,
        "beam": Beam,
        "endpoint": Endpoint,
        "nav2_field": Nav2Field,
    },
    AbstractProposal: {
        "motion": MotionProposal,
        "matched": MatchedProposal,
        "fruit_fly": FruitFlyProposal,
        "gaussian": GaussianProposal,
    },
    AbstractResampler: {
        "systematic": SystematicResampler,
        "stratified": StratifiedResampler,
        "residual": ResidualResampler,
        "multinomial": MultinomialResampler,
    },
}
"""Registered classes by name, for each abstract class. Each class must be constructible without arguments."""


def choices(part: object) -> dict[str, type[eqx.Module]]:
    """Return the classes that can replace `part`, by name; empty if `part` is not a choice."""
    for base, named in VARIANTS.items():
        if isinstance(part, base):
            return named
    return {}


def kind(part: object) -> str:
    """Return the registered name of the class of `part`.

    Raises:
        ValueError: the class is not registered.
    """
    for name, variant in choices(part).items():
        if type(part) is variant:
            return name
    raise ValueError(f"{type(part).__name__} is not registered: add it to jaxslam.config.registry.VARIANTS")
