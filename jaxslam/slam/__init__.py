"""SLAM filters: `init`, `step`, and the trajectory of a particle."""

from jaxslam.slam.rbpf import RBPF, RBPFState, StepInfo, trajectory

__all__ = ["RBPF", "RBPFState", "StepInfo", "trajectory"]
