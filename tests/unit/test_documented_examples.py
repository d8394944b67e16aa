"""The examples of the pages, taken out of them and run as they stand."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import torch

DOCS = Path(__file__).parents[2] / "resources" / "docs"


def blocks(page: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", (DOCS / page).read_text(), re.MULTILINE | re.DOTALL)


def test_the_example_of_the_rasterizer_learns_from_its_gradients() -> None:
    (example,) = blocks("rasterizer.md")
    torch.manual_seed(3)
    names: dict[str, Any] = {}
    exec(compile(example, "rasterizer.md", "exec"), names)
    assert names["rgb"].shape == (64, 96, 3) and names["alpha"].shape == (64, 96)
    assert all(bool((leaf.grad != 0).any()) for leaf in names["leaves"])
    assert names["losses"][-1] < 0.2 * names["losses"][0]
    assert names["rgb"][32, 48].tolist() == pytest.approx([0.8, 0.4, 0.1], abs=0.15)
