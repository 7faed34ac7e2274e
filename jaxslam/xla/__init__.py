"""Helpers for XLA: compiler options, control flow, materialization, memory limits and sharding."""
