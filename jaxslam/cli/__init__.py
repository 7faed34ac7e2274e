"""The `jaxslam` command."""

from jaxslam.cli.main import main

__all__ = ["main"]
