"""Read the folder of an agent with the data loaders of the agent itself, from its source, for agents whose simulator or
network is not available here. `agent_environments` calls them.

The loaders run unchanged. Outside of them:

- packages that a loader imports but does not call may be missing, and Habitat's simulator is missing
- `habitat-lab` is a clone of the newest version; VLN-CE and NaVid were written for version 0.1.7
- the tokenizer has Qwen's special tokens, but only single bytes as words
"""

from __future__ import annotations

import gzip
import json
import os
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace as Options
from typing import Any

import numpy as np

SPLITS = ("train", "val_seen", "val_unseen")


def streamvln(checkouts: Path, data: Path) -> Iterator[str]:
    """Yields a line for each sample of StreamVLN's training dataset, in batches, and for each episode of its
    evaluation."""
    sys.path.insert(0, str(checkouts / "StreamVLN"))
    from llava import conversation  # type: ignore[import-not-found]
    from streamvln.dataset.vln_action_dataset import (  # type: ignore[import-not-found]
        VLNActionDataset,
        collate_fn,
    )
    from torch.utils.data import DataLoader

    conversation.default_conversation = conversation.conv_templates["qwen_1_5"]
    tokenizer = _qwen_tokenizer()
    options = Options(video_folder=str(data / "train"), image_size=384, transform_train=None, remove_init_turns=False)
    options.num_frames, options.num_history, options.num_future_steps = 32, 8, 4
    samples = VLNActionDataset(tokenizer, options, 0)
    for batch in DataLoader(samples, 2, collate_fn=lambda batch: collate_fn(batch, tokenizer)):
        assert batch["images"].shape[2:] == (3, 384, 384)
        assert (batch["labels"] >= 0).any(dim=1).all()
        yield from ["sample"] * len(batch["images"])
    yield from _habitat_lab(checkouts, data / "data/datasets/r2r", data / "data/scene_datasets")


def internnav(checkouts: Path, data: Path) -> Iterator[str]:
    """Yields a line for each sample of InternNav's training dataset, for system 2 and for both systems, and for each
    episode of its evaluation."""
    sys.path.insert(0, str(checkouts / "InternNav"))
    os.chdir(data)  # its table of datasets has relative paths
    from internnav.dataset.internvla_n1_lerobot_dataset import (  # type: ignore[import-not-found]
        DataCollatorForSupervisedDataset,
        NavPixelGoalDataset,
    )
    from torch.utils.data import DataLoader
    from transformers import Qwen2VLImageProcessor  # type: ignore[import-not-found]

    tokenizer = _qwen_tokenizer()
    options = Options(vln_dataset_use="r2r_125cm_0_30", model_type="qwen2.5vl", sample_step=4, predict_step_num=32)
    options.num_future_steps, options.num_history = 4, 8
    options.image_processor = Qwen2VLImageProcessor(min_pixels=3136, max_pixels=313600)
    options.transform_train = lambda image: image.resize((384, 384))
    for options.pixel_goal_only in (False, True):
        samples = NavPixelGoalDataset(tokenizer, options)
        assert len(samples) > 0
        for batch in DataLoader(samples, 2, collate_fn=DataCollatorForSupervisedDataset(tokenizer)):
            count, width = batch["input_ids"].shape
            assert batch["position_ids"] is None or batch["position_ids"].shape == (3, count, width)
            assert not options.pixel_goal_only or np.isfinite(batch["traj_poses"]).all()
            yield from ["sample"] * count
    yield from _habitat_lab(checkouts, data / "data/vln_ce/raw_data/r2r", data / "data/scene_data/mp3d_ce")


def vlnce(checkouts: Path, data: Path) -> Iterator[str]:
    """Yields a line for each episode that VLN-CE's dataset reads and whose path its nDTW accepts."""
    sys.path.insert(0, str(checkouts / "VLN-CE"))
    _package("habitat_extensions", checkouts / "VLN-CE" / "habitat_extensions")
    yield from _vlnce(checkouts, data, "habitat_extensions")


def navid(checkouts: Path, data: Path) -> Iterator[str]:
    """Yields a line for each episode that NaVid's dataset reads and whose path its nDTW accepts."""
    folder = checkouts / "NaVid-VLN-CE" / "VLN_CE"
    _package("VLN_CE", folder)
    _package("VLN_CE.habitat_extensions", folder / "habitat_extensions")
    yield from _vlnce(checkouts, data, "VLN_CE.habitat_extensions")


LOADERS = {"streamvln": streamvln, "internnav": internnav, "vlnce": vlnce, "navid": navid}


def _vlnce(checkouts: Path, data: Path, package: str) -> Iterator[str]:
    from importlib import import_module

    _habitat(checkouts)
    import_module("habitat.core.utils").try_cv2_import = lambda: None  # as in habitat-lab 0.1.7
    sys.modules[package].maps = types.ModuleType("maps")  # draws only
    dataset, measures = import_module(f"{package}.task"), import_module(f"{package}.measures")
    folder = data / "data/datasets/R2R_VLNCE_v1-3_preprocessed/{split}"
    options = Options(DATA_PATH=f"{folder}/{{split}}.json.gz", GT_PATH=f"{folder}/{{split}}_gt.json.gz", FDTW=True)
    options.SCENES_DIR, options.SUCCESS_DISTANCE = str(data / "data/scene_datasets"), 3.0
    options.CONTENT_SCENES = options.EPISODES_ALLOWED = ["*"]
    for options.SPLIT in SPLITS:
        assert dataset.VLNCEDatasetV1.check_config_paths_exist(options)
        robot = _Robot()
        measure = measures.NDTW(sim=robot, config=options)
        for episode in dataset.VLNCEDatasetV1(options).episodes:
            assert Path(episode.scene_id).is_file() and episode.instruction.instruction_text
            places = measure.gt_json[episode.episode_id]["locations"]
            assert np.allclose(places[0], episode.start_position, atol=1e-3)
            robot.place = places[0]
            measure.reset_metric(episode=episode)
            for robot.place in places[1:]:
                measure.update_metric()
            assert measure.get_metric() > 0.99  # a robot that follows the actions
            yield "episode"


def _habitat_lab(checkouts: Path, folder: Path, scenes: Path) -> Iterator[str]:
    """The episodes as habitat-lab's own R2RVLN-v1 reads them."""
    _habitat(checkouts)
    from habitat.datasets.vln.r2r_vln_dataset import VLNDatasetV1  # type: ignore[import-not-found]

    for split in SPLITS:
        options = Options(data_path=f"{folder}/{{split}}/{{split}}.json.gz", scenes_dir=str(scenes), split=split)
        options.content_scenes = ["*"]
        with gzip.open(folder / split / f"{split}_gt.json.gz") as file:
            actions = json.load(file)
        for episode in VLNDatasetV1(options).episodes:
            assert Path(episode.scene_id).is_file() and actions[str(episode.episode_id)]["actions"][-1] == 0
            yield "episode"


class _Robot:
    """Habitat's simulator, as measures see it."""

    place: list[float]

    def get_agent_state(self) -> Any:
        return Options(position=np.array(self.place))


def _habitat(checkouts: Path) -> None:
    """Makes the modules of habitat-lab importable without the packages that only its simulator needs."""
    root = checkouts / "habitat-lab" / "habitat-lab" / "habitat"
    for name in ("habitat", "habitat.core", "habitat.datasets", "habitat.datasets.vln", "habitat.tasks"):
        _package(name, root.joinpath(*name.split(".")[1:]))
    for name in ("habitat.tasks.nav", "habitat.tasks.vln", "habitat.utils"):
        _package(name, root.joinpath(*name.split(".")[1:]))


def _package(name: str, folder: Path) -> None:
    """Makes a package without running its __init__.py."""
    if name not in sys.modules:
        sys.modules[name] = types.ModuleType(name)
        sys.modules[name].__path__ = [str(folder)]


def _qwen_tokenizer() -> Any:
    from tokenizers import AddedToken, Tokenizer, decoders, models, pre_tokenizers  # type: ignore[import-not-found]
    from transformers import PreTrainedTokenizerFast  # type: ignore[import-not-found]

    letters = sorted(pre_tokenizers.ByteLevel.alphabet())
    words = letters + [f"<unused{i}>" for i in range(151643 - len(letters))]
    tokens = Tokenizer(models.BPE({word: i for i, word in enumerate(words)}, []))
    tokens.pre_tokenizer, tokens.decoder = pre_tokenizers.ByteLevel(add_prefix_space=False), decoders.ByteLevel()
    special = "endoftext im_start im_end object_ref_start object_ref_end box_start box_end quad_start quad_end"
    special += " vision_start vision_end vision_pad image_pad video_pad"
    tokens.add_special_tokens([AddedToken(f"<|{name}|>") for name in special.split()])
    return PreTrainedTokenizerFast(
        tokenizer_object=tokens,
        pad_token="<|endoftext|>",
        additional_special_tokens=["<|im_start|>", "<|im_end|>"],
        model_max_length=32768,
    )
