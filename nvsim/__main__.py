"""`python -m nvsim` is `nvsim`."""

import sys

from nvsim.cli.main import main

sys.exit(main())
