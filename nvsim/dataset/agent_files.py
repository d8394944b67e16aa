"""Write the folder that the scripts of an agent open, from the parts of a dataset: one table of agents and their files.

Files that exist in the dataset become hard links, or copies if the disk has no links. Sources: the loaders of VLN-DUET,
VLN-HAMT, Recurrent-VLN-BERT, EnvDrop, MapGPT, NavGPT, NavGPT-2, StreamVLN, VLN-CE, NaVid, and InternNav.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import string
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from nvsim.dataset.agent_readme import readme
from nvsim.dataset.text_views import TextViews, read_text_views
from nvsim.dataset.word_pieces import Vocabulary
from nvsim.errors import InputError
from nvsim.files import atomic
from nvsim.files.atomic import as_input_error
from nvsim.files.opening import parse_json, read_bytes, read_json, read_text
from nvsim.graph.connectivity import SUFFIX, scan_files
from nvsim.r2r.features.layouts import LAYOUTS
from nvsim.r2r.features.layouts import Name as LayoutName
from nvsim.r2r.tasks.exporting import BOXES, GOALS, SURROUNDINGS, reverie_file, soon_file
from nvsim.r2r.tasks.splitting import SPLITS
from nvsim.r2r.tasks.task import Task, read_tasks, write_tasks

if TYPE_CHECKING:
    from nvsim.r2r.features.exported_scan import ExportedScan

AgentName = Literal[
    "duet",
    "hamt",
    "recurrent-vln-bert",
    "envdrop",
    "mapgpt",
    "navgpt",
    "navgpt2",
    "streamvln",
    "vlnce",
    "navid",
    "internnav",
]
SCANS, FEATURES, TASKS, CANDIDATES, FRAMES = "scans", "features", "tasks", "candidates", "frames"
SCENES = "scenes"
"""Folders in a dataset."""
SEEN_IN_TRAINING = 50
"""Number of paths of train that agents also evaluate, as val_train_seen. VLN-DUET reads at most this number."""
_GOAL_FILE = "a file of goals", "export the dataset again"
_LEAST_USES = 5
"""Number of uses from which a word is in EnvDrop's vocabulary."""


@dataclass(frozen=True)
class DatasetParts:
    """The parts of a dataset folder that the files of agents are made from.

    root        contains scans/ with connectivity/, tasks/, and the features, frames, and scenes of the agent
    scans       ids of the scans, without the stub
    vocabulary  word pieces of the agent's BERT, None if none was named
    goals       whether tasks/ contains goals without language
    """

    root: Path
    scans: tuple[str, ...]
    vocabulary: Vocabulary | None = None
    goals: bool = False

    @cached_property
    def splits(self) -> dict[str, list[Task]]:
        """The tasks of each split, and of val_train_seen."""
        found = {name: read_tasks(self.root / TASKS / f"R2R_{name}.json") for name in SPLITS}
        return {**found, "val_train_seen": found["train"][:SEEN_IN_TRAINING]}

    @cached_property
    def exported(self) -> dict[str, ExportedScan]:
        from nvsim.r2r.features.exported_scan import read_exported_scans

        return {scan.id: scan for scan in read_exported_scans(self.root / SCANS, self.scans)}

    def write_candidates(self) -> None:
        """Writes the candidate files that agents without a simulator read."""
        from nvsim.r2r.features.candidates import write_candidates

        write_candidates(self.exported.values(), self.root / CANDIDATES)


Writer = Callable[[DatasetParts, Path, str], None]
"""Writes a file, or the files of a folder: (parts, path, split or scan)."""


@dataclass(frozen=True)
class Agent:
    """An agent and the files of its folder.

    title       name of the agent
    files       path in the folder -> its writer; {split} and {scan} stand for each split and each scan, and {steps} for
                each split of the episodes in small steps
    run         lines of a shell that run the agent; $FOLDER is the folder, $CHECKOUT the repository of the agent,
                $OUT a folder for its results, {val} the evaluated split, and {count} its number of instructions
    results     the trajectories that the agent writes, for `nvsim evaluate r2r`, or "" if it writes none of this format
    submits     line that makes the split `test`, which the agent also opens when it writes trajectories, or ""
    ran         what ran without changes to the code of the agent
    features    feature layouts in `files`
    views       whether `files` contain the 36 views of each viewpoint
    encoded     whether the agent reads instructions as word pieces of a vocabulary
    candidates  whether `files` contain candidate files
    frames      whether `files` contain StreamVLN annotations and the frames of their episodes
    look_down   whether frames that look down belong to them
    scenes      whether `files` contain scenes for Habitat and the VLN-CE episodes in them
    notes       sentences for the user
    goals       files for remote objects, which a dataset with goals adds
    goal_notes  sentences about these files
    """

    title: str
    files: Mapping[str, Writer]
    run: tuple[str, ...]
    ran: str
    results: str = ""
    submits: str = ""
    features: tuple[LayoutName, ...] = ()
    views: bool = False
    encoded: bool = False
    candidates: bool = False
    frames: bool = False
    look_down: bool = False
    scenes: bool = False
    notes: tuple[str, ...] = ()
    goals: Mapping[str, Writer] = field(default_factory=dict)
    goal_notes: tuple[str, ...] = ()

    def with_goals(self, goals: bool) -> Agent:
        """The agent with the files for remote objects among its files if `goals` is true."""
        if not goals:
            return self
        return replace(self, files={**self.files, **self.goals}, notes=(*self.notes, *self.goal_notes))


def link_writer(source: str) -> Writer:
    """A writer that links a file or a folder of the dataset; placeholders are replaced in `source`."""

    def write(parts: DatasetParts, path: Path, of: str) -> None:
        _link(parts.root / _fill_pattern(source, of), path)

    return write


def _features(name: LayoutName) -> Writer:
    return link_writer(f"{FEATURES}/{LAYOUTS[name].file}")


def _connectivity(parts: DatasetParts, path: Path, of: str) -> None:
    from nvsim.r2r.observations import stub

    files = scan_files(parts.root / SCANS, parts.scans)
    for file in files.values():
        atomic.write_bytes(path / file.name, read_bytes(file))
    own = parts.root / SCANS / "connectivity" / f"{stub.SCAN}{SUFFIX}"
    if own.is_file():
        atomic.write_bytes(path / own.name, read_bytes(own))
    atomic.write_text(path / "scans.txt", "".join(f"{scan}\n" for scan in files))
    stub.write_stub_graph(path)


def _items(parts: DatasetParts, split: str) -> Iterator[dict[str, Any]]:
    """The tasks of a split as DUET's items: R2R's, with `instr_encodings` if there is a vocabulary."""
    for task in parts.splits[split]:
        item: dict[str, Any] = {
            "distance": task.distance,
            "scan": task.scan,
            "path_id": task.path_id,
            "path": list(task.path),
            "heading": task.heading,
            "instructions": list(task.instructions),
        }
        if parts.vocabulary is not None:
            item["instr_encodings"] = [parts.vocabulary.encode(text) for text in task.instructions]
        yield item


def _single(parts: DatasetParts, split: str) -> Iterator[dict[str, Any]]:
    """The same, with one item for each instruction: `instr_id` and `instruction` replace the lists."""
    for item in _items(parts, split):
        texts, codes = item.pop("instructions"), item.pop("instr_encodings", None)
        for k, text in enumerate(texts):
            one = {**item, "instr_id": f"{item['path_id']}_{k}", "instruction": text}
            yield one if codes is None else {**one, "instr_encoding": codes[k]}


def _write_encoded(parts: DatasetParts, path: Path, split: str) -> None:
    atomic.write_text(path, json.dumps(list(_items(parts, split))) + "\n")


def _flat(parts: DatasetParts, path: Path, split: str) -> None:
    atomic.write_text(path, json.dumps(list(_single(parts, split))) + "\n")


def _write_remote(parts: DatasetParts, path: Path, split: str) -> None:
    """The items of REVERIE, with `instr_encodings`."""
    assert parts.vocabulary is not None
    source = parts.root / TASKS / GOALS / reverie_file("train" if split == "val_train_seen" else split)
    included = {task.path_id for task in parts.splits[split]}
    items = [item for item in read_json(source, *_GOAL_FILE) if item["path_id"] in included]
    for item in items:
        item["instr_encodings"] = [parts.vocabulary.encode(text) for text in item["instructions"]]
    atomic.write_text(path, json.dumps(items) + "\n")


def _outlined(split: str) -> Writer:
    """A writer of the items of SOON of a split, with `instr_encodings`."""

    def write(parts: DatasetParts, path: Path, of: str) -> None:
        assert parts.vocabulary is not None
        encode = parts.vocabulary.encode
        source = parts.root / TASKS / GOALS / soon_file(split)
        items = [parse_json(source, line, *_GOAL_FILE) for line in read_text(source, *_GOAL_FILE).splitlines()]
        for item in items:
            item["instr_encodings"] = [{k: encode(text) for k, text in one.items()} for one in item["instructions"]]
        atomic.write_text(path, "".join(json.dumps(item) + "\n" for item in items))

    return write


def _pretraining(parts: DatasetParts, path: Path, split: str) -> None:
    keys = ("instr_id", "scan", "path", "heading", "instr_encoding")
    items = [{key: item[key] for key in keys} | {"pos_vps": item["path"][-1:]} for item in _single(parts, split)]
    atomic.write_text(path, "".join(json.dumps(item) + "\n" for item in items))


def _plain(parts: DatasetParts, path: Path, split: str) -> None:
    write_tasks(path, parts.splits[split])


def _id_paths(parts: DatasetParts, path: Path, of: str) -> None:
    """The scan and the path of every path id, from which Recurrent-VLN-BERT computes nDTW."""
    tasks = (task for split in SPLITS for task in parts.splits[split])
    found = {str(task.path_id): [task.scan, list(task.path)] for task in tasks}
    atomic.write_text(path, json.dumps(found) + "\n")


def _vocabulary(*splits: str) -> Writer:
    """A writer of the words of splits in the order of their frequency, as EnvDrop's `build_vocab` finds them."""

    def write(parts: DatasetParts, path: Path, of: str) -> None:
        texts = (text for split in splits for task in parts.splits[split] for text in task.instructions)
        counts = Counter(token for text in texts for token in _tokens(text))
        words = [word for word, count in counts.most_common() if count >= _LEAST_USES]
        atomic.write_text(path, "".join(f"{word}\n" for word in ("<PAD>", "<UNK>", "<EOS>", *words)))

    return write


def _tokens(text: str) -> Iterator[str]:
    for part in re.split(r"(\W+)", text.strip()):
        word = part.strip().lower()
        is_punctuation = word and all(c in string.punctuation for c in word) and set(word) != {"."}
        yield from word if is_punctuation else [word] if word else []


def _texts(texts_of: Callable[[TextViews], object]) -> Writer:
    """Writes {viewpoint: texts_of(its texts)}."""

    def write_scan(parts: DatasetParts, path: Path, scan: str) -> None:
        views = read_text_views(parts.root / TASKS / SURROUNDINGS, parts.exported[scan])
        values = {id: texts_of(one) for id, one in views.items()}
        atomic.write_text(path, json.dumps(values, separators=(",", ":")))

    return write_scan


def _lerobot(parts: DatasetParts, path: Path, scan: str) -> None:
    from nvsim.dataset.lerobot import write_lerobot

    paths = {task.path_id for task in parts.splits["train"] if task.scan == scan}
    annotations = parts.root / TASKS / "streamvln" / "train" / "annotations.json"
    found = read_json(annotations, "annotations of StreamVLN", "export the dataset again")
    for source, target in write_lerobot([o for o in found if o["id"] in paths], parts.root / FRAMES / "train", path):
        _link(source, target)


def _habitat(episodes: str, scenes: str) -> dict[str, Writer]:
    """Writers of the VLN-CE episodes of every split, and of the scenes for Habitat, in these folders."""
    both = {
        f"{episodes}/{{steps}}/{{steps}}{end}": link_writer(f"{TASKS}/vlnce/{{steps}}/{{steps}}{end}") for end in _ENDS
    }
    return {**both, f"{scenes}/nvsim": link_writer(f"{SCENES}/nvsim")}


_ENDS = (".json.gz", "_gt.json.gz")
_VLNCE = _habitat("data/datasets/R2R_VLNCE_v1-3_preprocessed", "data/scene_datasets")
_NO_WORD_VECTORS = (
    "The agent's embeddings.json.gz has vectors for the words of R2R; train without use_pretrained_embeddings."
)
_NO_OTHER_DATA = "If the checkout already has a folder {}, `ln` refuses to replace it; rename that folder first."
_ANNOTATIONS = {
    "R2R/connectivity": _connectivity,
    "R2R/annotations/R2R_{split}_enc.json": _write_encoded,
}
_REVERIE = {
    "REVERIE/annotations/REVERIE_{split}_enc.json": _write_remote,
    "REVERIE/annotations/BBoxes.json": link_writer(f"{TASKS}/{GOALS}/{BOXES}"),
}
_SOON = {
    f"SOON/annotations/bert_enc/{name}_enc.jsonl": _outlined(split)
    for name, split in (
        ("train", "train"),
        ("val_train", "train"),
        ("val_unseen_instrs", "val_seen"),
        ("val_unseen_house", "val_unseen"),
    )
}
_TEST = 'cp "$FOLDER/R2R/annotations/R2R_{val}_enc.json" "$FOLDER/R2R/annotations/R2R_test_enc.json"'
_SCRIPT = (
    'cd "$CHECKOUT/map_nav_src"',
    "export PYTHONPATH=.",
    'sed -i "s#^DATA_ROOT=.*#DATA_ROOT=$FOLDER#" scripts/run_r2r.sh',
    "nvsim r2r python -- bash scripts/run_r2r.sh",
)
AGENTS: dict[AgentName, Agent] = {
    "duet": Agent(
        "VLN-DUET",
        {
            **_ANNOTATIONS,
            "R2R/annotations/pretrain_map/R2R_{split}_enc.jsonl": _pretraining,
            "R2R/annotations/scanvp_candview_relangles.json": link_writer(
                f"{CANDIDATES}/scanvp_candview_relangles.json"
            ),
            "R2R/features/pth_vit_base_patch16_224_imagenet.hdf5": _features("vit-b16"),
        },
        _SCRIPT,
        "20 steps of its training with a small network of random weights on a CPU, and its evaluation; its "
        "pre-training: not run",
        features=("vit-b16",),
        encoded=True,
        candidates=True,
        results='"$FOLDER/R2R/exprs_map/finetune/dagger-vitbase-seed.0-init.aug.45k/preds/submit_{val}.json"',
        submits=_TEST,
        notes=(
            "Name the pre-trained model in the script (--bert_ckpt_file), or remove that option.",
            "The second command of the script, which writes the trajectories, names best_val_unseen of the authors "
            "(--resume_file); name that of your training, ckpts/best_val_unseen in its output folder.",
            "The pre-training also names R2R_prevalent_aug_train_enc.jsonl; remove it from its configuration.",
        ),
        goals={
            **_REVERIE,
            "REVERIE/features/obj.avg.top3.min80_vit_base_patch16_224_imagenet.hdf5": link_writer(
                f"{FEATURES}/objects.hdf5"
            ),
            **_SOON,
            "SOON/features/filtered_butd_bboxes.hdf5": link_writer(f"{FEATURES}/objects_corners.hdf5"),
        },
        goal_notes=(
            "REVERIE and SOON run in the same way with scripts/run_reverie.sh and scripts/run_soon.sh. In the second "
            "script, set obj_ft_dim=768. To write trajectories, both need annotations of a split `test`, and SOON also "
            "of `test_v2`. 20 steps of their training and their evaluation ran, too.",
        ),
    ),
    "hamt": Agent(
        "VLN-HAMT",
        {**_ANNOTATIONS, "R2R/features/pth_vit_base_patch16_224_imagenet.hdf5": _features("vit-b16")},
        (
            'cd "$CHECKOUT/finetune_src"',
            "export PYTHONPATH=.",
            'nvsim r2r python -- python r2r/main.py --root_dir "$FOLDER" --features vitbase --image_feat_size 768 '
            '--output_dir "$OUT"',
        ),
        "20 steps of its training with a small network of random weights on a CPU, and its evaluation",
        features=("vit-b16",),
        encoded=True,
        results='"$OUT/preds/submit_{val}.json"',
        submits=_TEST,
        notes=(
            "Add the other options of its scripts/run_r2r.sh, except --aug, whose file NVSim does not write. "
            "--bert_ckpt_file names the pre-trained model.",
            "To write the trajectories, run the command again with --test --submit, and with "
            '--resume_file "$OUT/ckpts/best_val_unseen" in place of --bert_ckpt_file.',
        ),
        goals={
            **_REVERIE,
            "REVERIE/features/obj_pth_vit_base_patch16_224_imagenet_r2r.e2e.ft.22k.hdf5": link_writer(
                f"{FEATURES}/objects.hdf5"
            ),
        },
        goal_notes=(
            "REVERIE runs in the same way with reverie/main_navref.py, and with the options of scripts/run_reverie.sh "
            "except --features vitbase. 20 steps of its training and its evaluation ran, too.",
        ),
    ),
    "recurrent-vln-bert": Agent(
        "Recurrent-VLN-BERT",
        {
            "connectivity": _connectivity,
            "data/R2R_{split}.json": _plain,
            "data/id_paths.json": _id_paths,
            "img_features/ResNet-152-places365.tsv": _features("resnet-152-places365"),
        },
        (
            'cd "$FOLDER"',
            'ln -sfn "$CHECKOUT/Prevalent" .',
            "mkdir -p snap/first logs",
            'nvsim r2r python -- python "$CHECKOUT/r2r_src/train.py" --vlnbert prevalent --train listener '
            "--features places365 --name first",
        ),
        "20 steps of its training with a small network of random weights on a CPU",
        features=("resnet-152-places365",),
        results='"$FOLDER/snap/first/submit_{val}.json"',
        submits='cp "$FOLDER/data/R2R_{val}.json" "$FOLDER/data/R2R_test.json"',
        notes=(
            "The agent opens its files relative to the current folder, so it runs in this one.",
            "Add the other options of its run/train_agent.bash, except --aug, whose file NVSim does not write.",
            "To write the trajectories, run the command again with --train validlistener --submit 1 "
            "--load snap/first/state_dict/best_val_unseen.",
            "Scan ids contain no underscore, because the agent splits keys there.",
        ),
    ),
    "envdrop": Agent(
        "EnvDrop",
        {
            "connectivity": _connectivity,
            "tasks/R2R/data/R2R_{split}.json": _plain,
            "tasks/R2R/data/train_vocab.txt": _vocabulary("train"),
            "tasks/R2R/data/trainval_vocab.txt": _vocabulary(*SPLITS),
            "img_features/ResNet-152-imagenet.tsv": _features("resnet-152"),
        },
        (
            'cd "$FOLDER"',
            "mkdir -p snap/agent",
            'nvsim r2r python -- python "$CHECKOUT/r2r_src/train.py" --attn soft --train listener --featdropout 0.3 '
            "--angleFeatSize 128 --feedback sample --mlWeight 0.2 --subout max --dropout 0.5 --optim rms --lr 1e-4 "
            "--iters 80000 --maxAction 35 --name agent",
        ),
        "20 steps of its training with random weights on a CPU, and its evaluation",
        features=("resnet-152",),
        notes=("The agent opens its files relative to the current folder, so it runs in this one.",),
    ),
    "mapgpt": Agent(
        "MapGPT",
        {
            "R2R/connectivity": _connectivity,
            "R2R/annotations/{split}_processed.json": _flat,
            "images/{scan}": link_writer(f"{SCANS}/views/{{scan}}"),
        },
        (
            'cd "$CHECKOUT"',
            "export PYTHONPATH=.",
            'nvsim r2r python -- python vln/main_gpt.py --root_dir "$FOLDER" --img_root "$FOLDER/images" '
            '--split {val}_processed --llm gpt-4o-2024-05-13 --response_format json --save_pred --output_dir "$OUT"',
        ),
        "23 steps of `main_gpt.py` with a server in place of the model",
        views=True,
        results='"$OUT/preds"',
        notes=(
            "The agent sends images to the service of the model that you name. Its key is in GPT/api.py.",
            "The agent writes a file for each instruction. A second run needs another OUT, or an empty one.",
        ),
    ),
    "navgpt": Agent(
        "NavGPT",
        {
            "R2R/connectivity": _connectivity,
            "R2R/annotations/R2R_{split}_instr.json": _flat,
            "R2R/navigable/{scan}_navigable.json": link_writer(f"{CANDIDATES}/navigable/{{scan}}_navigable.json"),
            "R2R/observations_list_summarized/{scan}.json": _texts(lambda views: views.sentences),
            "R2R/observations_summarized/{scan}_summarized.json": _texts(lambda views: views.summary),
            "R2R/objects_list/{scan}.json": _texts(lambda views: views.found),
        },
        (
            'cd "$CHECKOUT/nav_src"',
            'python NavGPT.py --root_dir "$FOLDER" --val_env_name R2R_{val}_instr --iters {count} --output_dir "$OUT"',
        ),
        "30 steps of `NavGPT.py` with a server in place of the model",
        candidates=True,
        results='"$OUT/preds/submit_R2R_{val}_instr.json"',
        notes=(
            "--iters is the number of instructions of the split; without it, the agent stops after ten.",
            "The texts name the objects, doorways, and rooms of surroundings.json, where NavGPT's own texts are "
            "captions by a model.",
            "The agent sends texts to the service of the model that you name with --llm_model_name. Its key is in "
            "OPENAI_API_KEY.",
        ),
    ),
    "navgpt2": Agent(
        "NavGPT-2",
        {
            **_ANNOTATIONS,
            "R2R/annotations/scanvp_candidates.json": link_writer(f"{CANDIDATES}/scanvp_candidates.json"),
            "R2R/features/MP3D_eva_clip_g_can.lmdb": _features("eva-g"),
        },
        (
            'cd "$CHECKOUT/map_nav_src"',
            'sed -i "s#^DATA_ROOT=.*#DATA_ROOT=$FOLDER#" scripts/run_r2r_xl.sh',
            "nvsim r2r python -- bash scripts/run_r2r_xl.sh",
        ),
        "20 steps of its training with a small network of random weights on a CPU",
        features=("eva-g",),
        candidates=True,
        results='"$FOLDER/R2R/exprs_map/finetune/NavGPT2-XL-seed.0-bs2/preds/submit_{val}.json"',
        submits=_TEST,
        notes=("Its script names prevalent_aug.json (--aug); remove that option, or add the file.",),
    ),
    "streamvln": Agent(
        "StreamVLN",
        {
            "{steps}/annotations.json": link_writer(f"{TASKS}/streamvln/{{steps}}/annotations.json"),
            "{steps}/images": link_writer(f"{FRAMES}/{{steps}}"),
            **_habitat("data/datasets/r2r", "data/scene_datasets"),
        },
        (
            'cd "$CHECKOUT"',
            "mkdir -p data/datasets data/scene_datasets",
            'ln -sfn "$FOLDER/data/datasets/r2r" data/datasets/',
            'ln -sfn "$FOLDER/data/scene_datasets/nvsim" data/scene_datasets/',
            'python streamvln/streamvln_train.py --video_folder "$FOLDER/train"',
        ),
        "its training dataset reads every sample of train; its evaluation needs Habitat: not run",
        frames=True,
        scenes=True,
        notes=("Add the other options of its training script.", _NO_OTHER_DATA.format("data/datasets/r2r")),
    ),
    "vlnce": Agent(
        "VLN-CE",
        _VLNCE,
        (
            'cd "$CHECKOUT"',
            "mkdir -p data/datasets data/scene_datasets",
            'ln -sfn "$FOLDER/data/datasets/R2R_VLNCE_v1-3_preprocessed" data/datasets/',
            'ln -sfn "$FOLDER/data/scene_datasets/nvsim" data/scene_datasets/',
            "python run.py --exp-config vlnce_baselines/config/r2r_baselines/nonlearning.yaml --run-type eval",
        ),
        "its dataset reads every episode, and its nDTW the paths; its simulator Habitat: not run",
        scenes=True,
        notes=(_NO_WORD_VECTORS, _NO_OTHER_DATA.format("data/datasets/R2R_VLNCE_v1-3_preprocessed")),
    ),
    "navid": Agent(
        "NaVid",
        _VLNCE,
        (
            'cd "$CHECKOUT"',
            'sed -i "s#/raid/data/episodes#$FOLDER/data/datasets#; '
            's#/raid/data/scene_dataset/#$FOLDER/data/scene_datasets/#" '
            "VLN_CE/habitat_extensions/config/vlnce_task_navid_r2r.yaml",
            "bash eval_navid_vlnce.sh",
        ),
        "its dataset reads every episode, and its nDTW the paths; its simulator Habitat: not run",
        scenes=True,
        notes=(
            "Name its weights (MODEL_PATH) in eval_navid_vlnce.sh, and the number of your graphics cards (CHUNKS).",
        ),
    ),
    "internnav": Agent(
        "InternNav",
        {
            "traj_data/r2r/{scan}": _lerobot,
            **_habitat("data/vln_ce/raw_data/r2r", "data/scene_data/mp3d_ce"),
        },
        (
            'cd "$CHECKOUT"',
            "mkdir -p traj_data data/vln_ce/raw_data data/scene_data/mp3d_ce",
            'ln -sfn "$FOLDER/traj_data/r2r" traj_data/',
            'ln -sfn "$FOLDER/data/vln_ce/raw_data/r2r" data/vln_ce/raw_data/',
            'ln -sfn "$FOLDER/data/scene_data/mp3d_ce/nvsim" data/scene_data/mp3d_ce/',
            "python internnav/trainer/internvla_n1_trainer.py --vln_dataset_use r2r_125cm_0_30",
        ),
        "its training dataset reads the first 30 samples of train; its evaluation needs Habitat: not run",
        frames=True,
        look_down=True,
        scenes=True,
        notes=(
            "Add the other options of its scripts/train/qwenvl_train.",
            "traj_data has the paths of train for r2r_125cm_0_30, which is one of the cameras that its scripts name.",
            _NO_OTHER_DATA.format("traj_data/r2r"),
        ),
    ),
}


def check_agents(agents: Sequence[AgentName], vocabulary: Path | None, instructions: int) -> Vocabulary | None:
    """Reads the vocabulary before any work starts, None if none is named. Raises InputError if an agent needs a
    vocabulary or instructions that are missing, or if the vocabulary is unreadable."""
    if vocabulary is None:
        for name in agents:
            if AGENTS[name].encoded:
                raise InputError(
                    f"{AGENTS[name].title} reads instructions as word pieces; give --vocabulary, the vocab.txt of "
                    "bert-base-uncased."
                )
    if agents and not instructions:
        raise InputError(f"{AGENTS[agents[0]].title} needs instructions; give --instructions 1 or more.")
    return None if vocabulary is None else Vocabulary.read(vocabulary)


def write_agent(parts: DatasetParts, name: AgentName, folder: Path) -> list[Path]:
    """Writes the files of an agent and a README.md into `folder`; returns their paths. Other files in the folder, such
    as checkpoints of the agent, stay.

    Raises InputError if a part of the dataset is missing, if instructions cannot be encoded because there is no
    vocabulary, or if writing fails.
    """
    agent = AGENTS[name].with_goals(parts.goals)
    if agent.encoded and parts.vocabulary is None:
        raise InputError(f"{agent.title} reads instructions as word pieces; name a vocabulary.")
    written = []
    for pattern, writer in agent.files.items():
        for of in _values(pattern, parts):
            path = folder / _fill_pattern(pattern, of)
            atomic.make_folder(path.parent)
            writer(parts, path, of)
            written.append(path)
    val = "val_unseen" if parts.splits["val_unseen"] else "val_seen"
    count = sum(len(task.instr_ids) for task in parts.splits[val])
    evaluated = (parts.root / SCANS, parts.root / TASKS / f"R2R_{val}.json")
    atomic.write_text(folder / "README.md", readme(agent, folder, evaluated, val, count))
    return [*written, folder / "README.md"]


def count_files(name: AgentName, scans: Sequence[str], goals: bool) -> int:
    """Number of entries that `write_agent` returns."""
    parts = DatasetParts(Path(), tuple(scans), goals=goals)
    return 1 + sum(len(_values(pattern, parts)) for pattern in AGENTS[name].with_goals(goals).files)


def _values(pattern: str, parts: DatasetParts) -> tuple[str, ...]:
    """The values of the placeholder in a path, or one empty value."""
    if "{split}" in pattern:
        return (*SPLITS, "val_train_seen")
    if "{steps}" in pattern:
        return SPLITS
    return parts.scans if "{scan}" in pattern else ("",)


def _fill_pattern(pattern: str, of: str) -> str:
    return pattern.format(split=of, scan=of, steps=of)


def _link(source: Path, target: Path) -> None:
    """Links a file, or all files of a folder. Raises InputError if the source is missing or the disk refuses."""
    if source.is_dir():
        for one in sorted(source.iterdir()):
            _link(one, target / one.name)
        return
    if not source.is_file():
        raise InputError(f"{source} is missing; export the dataset again.")
    if target.is_file() and os.path.samefile(source, target):
        return
    with atomic.replacement_file(target) as temporary:
        try:
            os.link(source, temporary)
        except OSError:  # another disk, or a file system without hard links
            try:
                shutil.copyfile(source, temporary)
            except OSError as error:
                raise as_input_error(target, error) from error
