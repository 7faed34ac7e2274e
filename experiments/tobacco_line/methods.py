"""The methods of the comparison, as configurations."""

from experiments._harness.method import Method
from jaxslam.proposal import FruitFlyProposal, MatchedProposal, MotionProposal

_ONE_SWARM = {"proposal.swarm": "particles"}
_STANDARD = {
    "proposal.flies.exponential": False,
    "proposal.flies.crossover": False,
    "proposal.flies.mutation": False,
    "proposal.flies.num_generations": 20,
}

COMPARED = {
    "traditional-15": Method("traditional RBPF", "rbpf", 15, {}),
    "traditional-30": Method("traditional RBPF", "rbpf", 30, {}),
    "traditional-100": Method("traditional RBPF", "rbpf", 100, {}),
    "gmapping-15": Method("scan matching as gmapping", "gmapping", 15, {}),
    "gmapping-30": Method("scan matching as gmapping", "gmapping", 30, {}),
    "improved-15": Method("improved", "fruit-fly", 15, {}),
}
"""The comparison of Liang et al."""

ABLATION = {
    "no-ekf": Method("without EKF: wheels alone", "fruit-fly", 15, {"fusion.use": "off"}),
    "no-icp": Method("without ICP", "fruit-fly", 15, {"proposal.use_icp": False}),
    "no-flies": Method("without flies", "fruit-fly", 15, {"proposal.use_flies": False}),
    "standard-flies": Method("standard flies", "fruit-fly", 15, _STANDARD),
    "no-exponential": Method(
        "without the exponential step", "fruit-fly", 15, {"proposal.flies.exponential": False}
    ),
    "no-crossover": Method("without crossover", "fruit-fly", 15, {"proposal.flies.crossover": False}),
    "no-mutation": Method("without mutation", "fruit-fly", 15, {"proposal.flies.mutation": False}),
    "flies-alone": Method(
        "flies alone: neither EKF nor ICP",
        "fruit-fly",
        15,
        {"proposal.use_icp": False, "fusion.use": "off"},
    ),
    "one-swarm": Method("the particles as one swarm", "fruit-fly", 15, _ONE_SWARM),
    "density": Method("weights p/q, drawn from a Gaussian", "fruit-fly", 15, {"proposal.weight": "density"}),
    "traditional-30-ekf": Method("traditional RBPF with EKF", "rbpf", 30, {"fusion.use": "on"}),
    "gmapping-15-ekf": Method("gmapping with EKF", "gmapping", 15, {"fusion.use": "on"}),
}
"""The improved filter with one part changed, and the other filters with its fused odometry."""

EQUAL = {
    "equal-traditional": Method("traditional RBPF", "rbpf", 510, {}),
    "equal-gmapping": Method("scan matching as gmapping", "gmapping", 14, {}),
    "equal-improved": Method("improved, the particles as one swarm", "fruit-fly", 6, _ONE_SWARM),
}
"""Methods that need about 510 evaluations per scan each."""


def evaluations(method: Method) -> int:
    """Count how often a step evaluates a scan on a map, over all particles, without searches of lost ones."""
    proposal = method.configuration().proposal
    if isinstance(proposal, MotionProposal):
        each = 1
    elif isinstance(proposal, MatchedProposal):
        each = proposal.heading.num_headings + proposal.fine.num_iterations + 2
    elif isinstance(proposal, FruitFlyProposal):
        icp = proposal.icp.coarse_iterations + proposal.icp.num_iterations if proposal.use_icp else 1
        each = proposal.heading.num_headings + icp + 2
        if proposal.use_flies:
            flies = proposal.flies
            one_each = 1 + flies.num_generations * (2 if flies.improved else 1)
            swarm = one_each if proposal.swarm == "particles" else flies.num_evaluations
            each += swarm + (icp if proposal.polish else 0) + 1
        if proposal.weight == "density":
            each += proposal.around.num_poses + 1
    else:
        raise TypeError(f"{type(proposal).__name__}: its evaluations per step are unknown: add them here")
    return each * method.particles
