"""The classes that a configuration can choose from, by name.

Register a new proposal, motion model, sensor model or resampler here with one line. A class that is not
registered is called `module:Class`.
"""

import importlib
import operator
import sys

import equinox as eqx

from jaxslam import motion, proposal, resampling, sensor
from jaxslam.core.names import did_you_mean

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
    """Return the registered name of the class of `part`, or `module:Class` for any other class."""
    for name, variant in choices(part).items():
        if type(part) is variant:
            return name
    return f"{type(part).__module__}:{type(part).__qualname__}"


def build(part: object, name: str) -> eqx.Module:
    """Return the defaults of another class that can replace `part`, which is a choice.

    Args:
        part: part of a configuration.
        name: registered name, or `module:Class`. The module is installed or lies in the current folder.

    Raises:
        ValueError: no such class exists, or it cannot replace `part`.
    """
    base, known = next((base, named) for base, named in VARIANTS.items() if isinstance(part, base))
    if name in known:
        return known[name]()
    module, colon, path = name.partition(":")
    if not colon:
        others = f"There are {', '.join(known)}, and module:Class for a class of your own"
        raise ValueError(f"{did_you_mean(name, known)}{others}")
    if "" not in sys.path:
        # The `jaxslam` command does not search the current folder by itself.
        sys.path.append("")
    try:
        found = operator.attrgetter(path)(importlib.import_module(module))
    except (ImportError, AttributeError, ValueError) as error:
        raise ValueError(
            f"{error}: give a class in a module of the current folder or an installed one"
        ) from None
    if not (isinstance(found, type) and issubclass(found, base)):
        raise ValueError(f"{path} is not a subclass of {base.__name__}: derive it from {base.__name__}")
    try:
        return found()
    except TypeError as error:
        raise ValueError(f"{error}: implement every method and give every field a default") from None
