"""`python -m jaxslam.cli` is the `jaxslam` command."""

import sys

from jaxslam.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
