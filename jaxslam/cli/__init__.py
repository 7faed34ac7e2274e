"""The `jaxslam` command."""

from jaxslam.cli.entry import main

__all__ = ["main"]
