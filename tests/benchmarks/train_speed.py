"""Print the cost of a training step and of its parts as one JSON object: python tests/benchmarks/train_speed.py"""

from __future__ import annotations

import json

from nvsim.benchmarks.train import measure

if __name__ == "__main__":
    print(json.dumps(measure()))
