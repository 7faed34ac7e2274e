"""Worlds to simulate in."""
