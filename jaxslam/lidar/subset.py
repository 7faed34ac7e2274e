"""Which beams to look at where not all are needed."""

import numpy as np
from jaxtyping import Int


def spread_beams(num_beams: int, max_beams: int) -> Int[np.ndarray, "chosen"]:
    """Ascending indices of at most `max_beams` of `num_beams` beams, evenly spread, the ends included.

    Example:
        `spread_beams(5, 3)` is `[0, 2, 4]`, and `spread_beams(3, 5)` is `[0, 1, 2]`.
    """
    # Whole strides would throw away up to half of what is allowed.
    return np.round(np.linspace(0, num_beams - 1, min(max_beams, num_beams))).astype(np.int32)
