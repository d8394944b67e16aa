"""`python -m nvsim` is `nvsim`."""

import os
import sys

if __name__ == "__main__":
    # Python puts the current folder first, so that a file such as app.py or resources.py there would be imported in
    # place of ours. A checkout of NVSim itself is needed there.
    here = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
    if not sys.flags.safe_path and os.path.realpath(sys.path[0]) != here:
        del sys.path[0]

    from nvsim.cli.main import main

    sys.exit(main())
