"""A small exported dataset for the recurrent agent: houses, tasks with instructions, features by chance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from task_samples import exported, house

from nvsim.graph.types import NavGraph
from nvsim.r2r.features.feature_files import RowSource, write_hdf5
from nvsim.r2r.instructions.generating import instruct
from nvsim.r2r.recurrent.config import LearningConfig, ModelConfig
from nvsim.r2r.tasks.exporting import export_tasks
from nvsim.r2r.tasks.shortest import PathBounds
from nvsim.r2r.tasks.splitting import PathCounts, sample_tasks

FEATURES = "pth_vit_base_patch16_224_imagenet.hdf5"
SMALL = ModelConfig(width=32, heads=2, text_layers=1, step_layers=1, dropout=0.0, feature_dropout=0.0)
QUICK = LearningConfig(iterations=12, batch=8, evaluate_every=6, checkpoint_every=4, threads=1, warm_up=5, rate=1e-3)


def dataset(folder: Path, scans: int = 3, paths: int = 30, width: int = 16, unseen: tuple[str, ...] = ()) -> Path:
    """An export with tasks/ and features/ in it; the scans are H0, H1 and so on, of two rooms each."""
    graphs = [house(f"H{i}", rooms=2, seed=i) for i in range(scans)]
    exported(folder, *graphs)
    amounts = PathCounts(paths, 2, 6, unseen_share=0.4)
    told = instruct(sample_tasks(graphs, unseen, PathBounds(), amounts), graphs, 2, 0)
    export_tasks(told.dataset, folder / "tasks", PathBounds(), amounts, {})
    write_features(folder / "features" / FEATURES, graphs, width)
    return folder


def write_features(path: Path, graphs: list[NavGraph], width: int, backbone: str = "chance") -> Path:
    random = np.random.default_rng(0)
    rows = (
        (RowSource(graph.scan, id, (640, 480)), random.standard_normal((36, width)).astype(np.float32))
        for graph in graphs
        for id in graph.viewpoints
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    write_hdf5(path, rows, {"backbone": backbone}, 60)
    return path
