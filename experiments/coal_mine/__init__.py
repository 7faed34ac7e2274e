"""Yang et al. 2019: mapping a self-similar coal-mine roadway, and localizing in its map."""
