"""The classes that a configuration can choose from, by name.

Register a new proposal, motion model, sensor model or resampler here with one line.
"""

import equinox as eqx

from jaxslam import motion, proposal, resampling, sensor

VARIANTS: dict[type[eqx.Module], dict[str, type[eqx.Module]]] = {
    motion.AbstractMotionModel: {
        "odometry": motion.OdometryMotion,
        "velocity": motion.VelocityMotion,
        "omnidirectional": motion.OmnidirectionalMotion,
        "gaussian": motion.GaussianMotion,
    },
    sensor.AbstractSensorModel: {
        "likelihood_field": sensor.LikelihoodField,
        "beam": sensor.Beam,
        "endpoint": sensor.Endpoint,
        "nav2_field": sensor.Nav2Field,
    },
    proposal.AbstractProposal: {
        "motion": proposal.MotionProposal,
        "matched": proposal.MatchedProposal,
        "fruit_fly": proposal.FruitFlyProposal,
        "gaussian": proposal.GaussianProposal,
    },
    resampling.AbstractResampler: {
        "systematic": resampling.SystematicResampler,
        "stratified": resampling.StratifiedResampler,
        "residual": resampling.ResidualResampler,
        "multinomial": resampling.MultinomialResampler,
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
