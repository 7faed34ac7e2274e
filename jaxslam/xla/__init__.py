"""Helpers that keep XLA from generating slow code; each file has one technique and its measurement."""
