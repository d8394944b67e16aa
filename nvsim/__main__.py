"""`python -m nvsim` is `nvsim`."""

import sys

from nvsim.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
