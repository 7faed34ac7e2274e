"""Scripts that compare methods, settings and sensors; each a package that `python -m` starts."""
