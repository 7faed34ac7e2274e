"""Levenberg–Marquardt against Adam on the calibrations of several lidars."""

import time

import numpy as np

from experiments._harness.harness import Arrays, Cell, stack_seeds
from experiments.range_network.devices import Quality, calibration, device, learnt
from jaxslam.report.training_folder import distance_errors, role_errors


def run_cell(cell: Cell) -> Arrays:
    """Train the networks of all lidars of a cell."""
    settings = cell.settings
    quality = Quality(settings["bias"], settings["noise"])
    return stack_seeds([_train(quality, unit, settings["method"]) for unit in range(settings["seeds"])])


def _train(quality: Quality, unit: int, method) -> Arrays:
    # The first call compiles; the second one is timed.
    learnt(quality, unit, method, restarts=1)
    begun = time.perf_counter()
    found = learnt(quality, unit, method, restarts=1)
    seconds = time.perf_counter() - begun
    readings = calibration(device(quality, unit), unit)
    roles = {row.role: row for row in role_errors(distance_errors(found.network, readings, found.split))}
    return {
        "seconds": np.asarray(seconds),
        "steps": np.asarray(found.fit.steps),
        "mse_learnt": np.asarray(roles["training"].corrected_rmse ** 2),
        "held_out": np.asarray(roles["held out"].corrected_rmse),
        "held_out_raw": np.asarray(roles["held out"].raw_rmse),
        "held_out_noise": np.asarray(roles["held out"].noise),
    }
