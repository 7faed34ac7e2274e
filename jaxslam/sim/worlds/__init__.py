"""Worlds of the simulator."""
