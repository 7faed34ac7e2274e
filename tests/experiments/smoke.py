"""Runs an experiment as a user does."""

import subprocess
import sys
from pathlib import Path


def run_smoke(name: str, out: Path) -> None:
    """`python -m experiments.NAME --smoke`: its cells run in processes of their own."""
    command = [sys.executable, "-m", f"experiments.{name}", "--smoke", "--out", str(out)]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
