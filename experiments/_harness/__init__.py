"""What the experiments share: flags, cells, methods, measures, timing, pictures."""
