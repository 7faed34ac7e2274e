"""The second paper: FastSLAM with a Gaussian proposal, and localisation, in a coal-mine roadway."""
