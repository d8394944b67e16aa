"""Run the `nvsim` command as `python -m nvsim`."""

import os
import sys

if __name__ == "__main__":
    # Python puts the current folder first in sys.path. A file such as app.py or resources.py in that folder would then
    # hide the package of the same name. If the current folder is a checkout of NVSim, its entry stays.
    here = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
    if not sys.flags.safe_path and os.path.realpath(sys.path[0]) != here:
        del sys.path[0]

    from nvsim.cli.main import main

    sys.exit(main())
