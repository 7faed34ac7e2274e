"""Resampling: which particles continue, and when to resample."""

from jaxslam.resampling._permute import keep_survivors_in_place
from jaxslam.resampling.adaptive import AdaptiveResampling, Resampling
from jaxslam.resampling.base import AbstractResampler
from jaxslam.resampling.ess import effective_sample_size, normalize
from jaxslam.resampling.multinomial import MultinomialResampler
from jaxslam.resampling.residual import ResidualResampler
from jaxslam.resampling.stratified import StratifiedResampler
from jaxslam.resampling.systematic import SystematicResampler

__all__ = [
    "AbstractResampler",
    "AdaptiveResampling",
    "MultinomialResampler",
    "Resampling",
    "ResidualResampler",
    "StratifiedResampler",
    "SystematicResampler",
    "effective_sample_size",
    "keep_survivors_in_place",
    "normalize",
]
