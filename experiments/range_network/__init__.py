"""The third paper's experiment: a corridor by a cheap lidar, with and without the network."""
