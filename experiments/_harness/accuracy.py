"""The first columns of the tables of all experiments."""

from experiments._harness.harness import Arrays, spread_over_seeds
from experiments._harness.method import Method

ACCURACY_HEADER = ("method", "particles", "position RMSE, m", "heading RMSE, °", "IoU of walls (worst)")
_DEGREES = 57.29578


def accuracy_columns(method: Method, cell: Arrays) -> list[str]:
    """Return the name of the method, its number of particles and its accuracy over seeds."""
    iou = cell["iou"]
    return [
        method.title,
        str(method.particles),
        spread_over_seeds(cell["position_rmse"]),
        spread_over_seeds(cell["heading_rmse"], digits=2, scale=_DEGREES),
        f"{iou.mean():.3f} ± {iou.std():.3f} ({iou.min():.3f})",
    ]
