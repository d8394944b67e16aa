"""Run the `nvsim` command as `python -m nvsim`."""

import sys

if __name__ == "__main__":
    # Python puts the current folder first in sys.path. A file such as json.py or numpy.py in that folder would then
    # hide the package of the same name.
    if not sys.flags.safe_path:
        del sys.path[0]

    from nvsim.cli.main import main

    sys.exit(main())
