"""Checks of stamped poses, with the one-line errors that all metrics share."""

import numpy as np
from jaxtyping import Float


def check_stamps(stamps: Float[np.ndarray, "_"], name: str) -> None:
    """Refuses stamps that are none, not finite or run backwards; `name` is their track's."""
    if len(stamps) == 0:
        raise ValueError(f"the {name} has no poses: give a trajectory with at least one")
    if not np.isfinite(stamps).all():
        index = int(np.flatnonzero(~np.isfinite(stamps))[0])
        raise ValueError(f"{name} stamp {index} is {stamps[index]}: drop poses without a time")
    if (backwards := np.flatnonzero(np.diff(stamps) < 0)).size:
        index = int(backwards[0])
        raise ValueError(
            f"{name} stamps run backwards at {index}: {stamps[index]} then {stamps[index + 1]}; "
            "sort the trajectory by time"
        )


def check_poses(poses: Float[np.ndarray, "_ 3"], name: str, length: int) -> None:
    """Refuses poses that are not `length` many or not finite; `name` is their track's."""
    if len(poses) != length:
        raise ValueError(f"the {name} has {len(poses)} poses but should have {length}: match them")
    if not np.isfinite(poses).all():
        index = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise ValueError(f"{name} pose {index} is {poses[index]}: drop poses that are not finite")
