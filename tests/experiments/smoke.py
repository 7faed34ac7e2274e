"""Run an experiment as a user does."""

import subprocess
import sys
from pathlib import Path


def run_smoke(name: str, out: Path) -> None:
    """Run `python -m experiments.NAME --smoke`, whose cells run in separate processes."""
    command = [sys.executable, "-m", f"experiments.{name}", "--smoke", "--out", str(out)]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
