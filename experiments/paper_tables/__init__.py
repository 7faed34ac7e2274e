"""The catalogue of the experiments, and the page that compares their results with the papers."""
