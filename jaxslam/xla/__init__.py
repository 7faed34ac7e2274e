"""Helpers that keep XLA from generating slow code; each file is one trick and the measurement behind it."""
