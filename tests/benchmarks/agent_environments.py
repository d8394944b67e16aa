"""Run the unchanged scripts of published agents for a few steps on a dataset that `nvsim export dataset --for` wrote.

    python tests/benchmarks/agent_environments.py DATASET CHECKOUTS --agents duet navgpt --steps 20

CHECKOUTS contains a clone of each agent's repository, under the name of the repository. Every agent runs on a copy of
its clone and of its folder DATASET/agents/NAME, in which no file is written by hand. Of StreamVLN, VLN-CE, NaVid, and
InternNav, only the data loaders run (see `agent_loaders`); they also need a clone of habitat-lab. Outside of the
agent's code:

- networks have random weights and few layers, and `.cuda()` does nothing
- a local server answers as the language model
- packages that the script imports but does not call may be missing

The agents need torch, transformers (4.30), pytorch_transformers (1.0.0), tensorboardX, jsonlines, easydict,
progressbar2, and networkx; VLN-DUET on SOON shapely; MapGPT openai 1.3 and tenacity; NavGPT openai 0.28 and langchain
0.0.246; NavGPT-2 omegaconf, iopath, timm 0.4.12, einops, and sentencepiece. The loaders need attrs, fastdtw, and
numpy-quaternion, those of StreamVLN and InternNav also transformers 4.45, pyarrow, and pandas. `--paths` names folders
with packages of one agent: `mapgpt=FOLDER`.
"""

from __future__ import annotations

import json
import os
import random
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import types
from collections.abc import Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

import tyro

SHOWN = 15
"""Lines of the output that are shown if an agent fails."""


@dataclass(frozen=True)
class Run:
    """How an agent is run.

    repository  folder in CHECKOUTS
    folder      working folder in the copy of the repository, or "" for the folder of the exported files
    script      the script, relative to the copy of the repository, or "" if only the data loaders run
    options     its options; {data} is the folder of the exported files, {out} the folder of its results, and {steps}
                the number of steps
    counted     what counts as a step
    missing     packages that may be missing
    exported    the folder in DATASET/agents, or "" if it has the name of the run
    """

    repository: str
    folder: str
    script: str
    options: str
    counted: str = "training steps"
    missing: tuple[str, ...] = ()
    exported: str = ""


_SMALL = "--num_l_layers 1 --num_x_layers 1 --batch_size 2 --lr 1e-5 --optim adamW --ml_weight 0.2 --angle_feat_size 4 "
_UNUSED = (
    "deepspeed",
    "decord",
    "av",
    "open_clip",
    "timm",
    "einops",
    "einops_exts",
    "torchvision",
    "accelerate",
    "peft",
)
_UNUSED += ("trl", "flash_attn", "torchcodec", "gym", "habitat_sim", "magnum", "hydra", "omegaconf", "dtw", "yacs")
_UNUSED += ("habitat.config", "habitat.utils.visualizations", "habitat.sims")
_TRAINED = "--iters {steps} --log_every {steps} --max_action_len 15 --feat_dropout 0.4 --dropout 0.5 --world_size 1 "
_OBJECTS = (
    "--root_dir {data} --output_dir {out} --seed 0 --tokenizer bert --enc_full_graph --graph_sprels --fusion dynamic "
    "--multi_endpoints --dagger_sample sample --train_alg dagger --num_pano_layers 1 --max_instr_len 200 "
    "--max_objects 20 --features vitbase --image_feat_size 768 --obj_feat_size 768 --gamma 0. --eval_first "
)
RUNS = {
    "duet": Run(
        "VLN-DUET",
        "map_nav_src",
        "map_nav_src/r2r/main_nav.py",
        "--root_dir {data} --dataset r2r --output_dir {out} --seed 0 --tokenizer bert --enc_full_graph --graph_sprels "
        "--fusion dynamic --expert_policy spl --train_alg dagger --num_pano_layers 1 --max_instr_len 200 "
        "--features vitbase --image_feat_size 768 --gamma 0. --eval_first " + _SMALL + _TRAINED,
        missing=("line_profiler",),
    ),
    "hamt": Run(
        "VLN-HAMT",
        "finetune_src",
        "finetune_src/r2r/main.py",
        "--root_dir {data} --output_dir {out} --dataset r2r --ob_type pano --seed 0 --hist_enc_pano "
        "--hist_pano_num_layers 1 --fix_lang_embedding --fix_hist_embedding --features vitbase --feedback sample "
        "--max_instr_len 60 --image_feat_size 768 --eval_first " + _SMALL + _TRAINED,
    ),
    "duet-reverie": Run(
        "VLN-DUET",
        "map_nav_src",
        "map_nav_src/reverie/main_nav_obj.py",
        "--dataset reverie --obj_features vitbase " + _OBJECTS + _SMALL + _TRAINED,
        missing=("line_profiler",),
        exported="duet",
    ),
    "duet-soon": Run(
        "VLN-DUET",
        "map_nav_src",
        "map_nav_src/soon/main.py",
        "--dataset soon --obj_features butd " + _OBJECTS + _SMALL + _TRAINED,
        missing=("line_profiler",),
        exported="duet",
    ),
    "hamt-reverie": Run(
        "VLN-HAMT",
        "finetune_src",
        "finetune_src/reverie/main_navref.py",
        "--root_dir {data} --output_dir {out} --dataset reverie --multi_endpoints --ob_type pano --seed 0 "
        "--hist_enc_pano --hist_pano_num_layers 1 --no_lang_ca --features vitbase --feedback sample --max_instr_len 60 "
        "--image_feat_size 768 --obj_feat_size 768 --eval_first " + _SMALL + _TRAINED,
        exported="hamt",
    ),
    "recurrent-vln-bert": Run(
        "Recurrent-VLN-BERT",
        "",
        "r2r_src/train.py",
        "--vlnbert prevalent --train listener --features places365 --name first --maxAction 15 --batchSize 2 "
        "--feedback sample --lr 1e-5 --iters {steps} --optim adamW --mlWeight 0.20 --maxInput 80 --angleFeatSize 128 "
        "--featdropout 0.4 --dropout 0.5",
    ),
    "envdrop": Run(
        "R2R-EnvDrop",
        "",
        "r2r_src/train.py",
        "--attn soft --train listener --featdropout 0.3 --angleFeatSize 128 --feedback sample --mlWeight 0.2 "
        "--subout max --dropout 0.5 --optim rms --lr 1e-4 --iters {steps} --maxAction 35 --batchSize 8 --name agent",
    ),
    "mapgpt": Run(
        "MapGPT",
        ".",
        "vln/main_gpt.py",
        "--root_dir {data} --img_root {data}/images --split val_unseen_processed --end 4 --output_dir {out} "
        "--llm gpt-4o-2024-05-13 --response_format json --save_pred",
        counted="answers of the model",
    ),
    "navgpt": Run(
        "NavGPT",
        "nav_src",
        "nav_src/NavGPT.py",
        "--root_dir {data} --val_env_name R2R_val_unseen_instr --output_dir {out} --iters 3",
        counted="answers of the model",
    ),
    "navgpt2": Run(
        "NavGPT-2",
        "map_nav_src",
        "map_nav_src/r2r/main_nav.py",
        "--root_dir {data} --dataset r2r --output_dir {out} --seed 0 --tokenizer bert --enc_full_graph --graph_sprels "
        "--fusion global --expert_policy spl --train_alg dagger --num_x_layers 1 --max_action_steps 15 "
        "--max_instr_len 200 --batch_size 2 --features eva-clip-g --image_feat_size 1408 --angle_feat_size 4 "
        "--gamma 0. --freeze_qformer --llm_ctx_size 64 --lr 1e-5 --optim adamW --ml_weight 0.2 " + _TRAINED,
        missing=("torchvision", "decord", "spacy", "webdataset", "fairscale", "pycocoevalcap", "pycocotools", "plotly")
        + ("streamlit", "opendatasets", "skimage", "contexttimer", "matplotlib", "iopath", "ftfy", "cv2", "pandas"),
    ),
    "streamvln": Run("StreamVLN", ".", "", "", "samples and episodes", _UNUSED),
    "vlnce": Run("VLN-CE", ".", "", "", "episodes", _UNUSED),
    "navid": Run("NaVid-VLN-CE", ".", "", "", "episodes", _UNUSED),
    "internnav": Run("InternNav", ".", "", "", "samples and episodes", _UNUSED),
}


@dataclass(frozen=True)
class Arguments:
    dataset: tyro.conf.Positional[Path]
    checkouts: tyro.conf.Positional[Path]
    agents: tuple[str, ...] = tuple(RUNS)
    steps: int = 20
    paths: tuple[str, ...] = ()
    minutes: float = 20.0


def main() -> None:
    given = tyro.cli(Arguments, description=__doc__)
    paths = dict(one.split("=", 1) for one in given.paths)
    reached = {name: _try(name, given, paths.get(name)) for name in given.agents}
    print("\n| agent | steps | |\n|---|---|---|")
    for name, (steps, words) in reached.items():
        print(f"| {name} | {steps} {RUNS[name].counted} | {words} |")
    sys.exit(0 if all(steps >= given.steps and words == "finished" for steps, words in reached.values()) else 1)


def _try(name: str, given: Arguments, more: str | None) -> tuple[int, str]:
    """Runs an agent in a process of its own; returns the number of steps and how it ended."""
    run, nvsim = RUNS[name], str(Path(__file__).resolve().parents[2])
    with tempfile.TemporaryDirectory(prefix="agents_") as made, _LanguageModel() as model:
        work = Path(made)
        copy, data, out = work / run.repository, work / "data", work / "out"
        shutil.copytree(given.checkouts / run.repository, copy, symlinks=True)
        shutil.copytree(given.dataset / "agents" / (run.exported or name), data)
        out.mkdir()
        folder = copy / run.folder if run.folder else data
        for one in () if run.folder else ("logs", "snap/first", "snap/agent"):  # as in the README of the export
            (folder / one).mkdir(parents=True, exist_ok=True)
        options = run.options.format(data=data, out=out, steps=given.steps).split()
        # An empty entry of PYTHONPATH is the current folder; the agents' own READMEs set it so.
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*([more] if more else []), nvsim, ""])}
        environment |= {"OPENAI_BASE_URL": model.url, "OPENAI_API_BASE": model.url, "OPENAI_API_KEY": "none"}
        environment |= {"HF_HUB_OFFLINE": "1", "CUDA_VISIBLE_DEVICES": ""}
        environment |= {"COUNT": str(out / "steps"), "OMP_NUM_THREADS": "2"}
        log, start = work / "log.txt", time.monotonic()
        command = [sys.executable, "-m", "nvsim", "r2r", "python", "--", sys.executable, str(Path(__file__).resolve())]
        command += ["--inside", name, str(copy / run.script), *options]
        if not run.script:
            command = [sys.executable, str(Path(__file__).resolve()), "--load", name, str(given.checkouts), str(data)]
        with log.open("wb") as file:
            try:
                ended = subprocess.run(
                    command,
                    cwd=folder,
                    env=environment,
                    stdout=file,
                    stderr=subprocess.STDOUT,
                    timeout=60 * given.minutes,
                )
                words = "finished" if ended.returncode == 0 else f"exit code {ended.returncode}"
            except subprocess.TimeoutExpired:
                words = f"not finished in {given.minutes:g} minutes"
        counted = out / "steps"
        steps = int(counted.read_text()) if counted.is_file() else 0
        steps = model.answers if "model" in run.counted else steps
        lines = log.read_text(errors="replace").splitlines()
        if words != "finished" or not run.script:
            print("\n".join(line[:300] for line in lines[-(SHOWN if words != "finished" else 1) :]))
        print(f"{name}: {steps} {run.counted}, {words}, {time.monotonic() - start:.0f} s", flush=True)
        return steps, words


class _LanguageModel:
    """A server that answers requests of the OpenAI interface: a random action in the form that the prompt asks for."""

    def __init__(self) -> None:
        self.answers = 0
        outer, chosen = self, random.Random(1)

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                asked = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                outer.answers += 1
                message = {"role": "assistant", "content": _answer(json.dumps(asked), chosen)}
                body: dict[str, Any] = {"id": "1", "object": "chat.completion", "created": 1, "model": asked["model"]}
                body["choices"] = [{"index": 0, "message": message, "finish_reason": "stop"}]
                body["usage"] = {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2}
                data = json.dumps(body).encode()
                self.send_response(200)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            def log_message(self, *_: object) -> None: ...

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}/v1"

    def __enter__(self) -> _LanguageModel:
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()


def _answer(asked: str, chosen: random.Random) -> str:
    if "New Planning" in asked:  # MapGPT
        return json.dumps({"Thought": "none", "New Planning": "none", "Action": chosen.choice("ABC")})
    seen = re.findall(r"Navigable Viewpoints:\s*\{(.*?)\}", asked, re.DOTALL)
    found = re.findall(r"[0-9a-f]{32}", seen[-1] if seen else "")
    if not found:
        return "Action plan: go on."
    return f"Thought: none\nAction: action_maker\nAction Input: {chosen.choice(found)}"


def _inside(name: str, script: str, options: Sequence[str]) -> None:
    """The process of the agent: prepares what is outside its code, then runs its script."""
    run = RUNS[name]
    sys.meta_path.append(_Missing(run.missing))
    sys.path[0] = str(Path(script).parent)
    if name not in ("mapgpt", "navgpt"):
        _without_graphics_card(Path(os.environ["COUNT"]))
        _write_networks(name)
    sys.argv = [script, *options]
    runpy.run_path(script, run_name="__main__")


def _load(name: str, checkouts: str, data: str) -> None:
    """The process that reads the folder of an agent with its loaders."""
    from tests.benchmarks.agent_loaders import LOADERS

    sys.meta_path.insert(0, _Missing(RUNS[name].missing))
    counts: dict[str, int] = {}
    for what in LOADERS[name](Path(checkouts).resolve(), Path(data)):
        counts[what] = counts.get(what, 0) + 1
        Path(os.environ["COUNT"]).write_text(str(sum(counts.values())))
    print(counts)


def _without_graphics_card(counted: Path) -> None:
    """Makes `.cuda()` do nothing, and writes the number of training steps to a file."""
    import networkx
    import numpy as np
    import torch
    from torch.optim.optimizer import register_optimizer_step_post_hook

    steps: dict[int, int] = {}

    def count(optimizer: Any, *_: object) -> None:
        steps[id(optimizer)] = steps.get(id(optimizer), 0) + 1
        counted.write_text(str(max(steps.values())))

    register_optimizer_step_post_hook(count)

    def same(self: Any, *_: object, **__: object) -> Any:
        return self

    torch.Tensor.cuda = torch.nn.Module.cuda = same  # type: ignore[method-assign]

    def without_cuda(move: Any) -> Any:
        def moved(self: Any, *to: Any, **named: Any) -> Any:
            device = named.get("device", to[0] if to else None)
            return (
                self if isinstance(device, str | torch.device) and "cuda" in str(device) else move(self, *to, **named)
            )

        return moved

    torch.Tensor.to = without_cuda(torch.Tensor.to)  # type: ignore[method-assign]
    torch.nn.Module.to = without_cuda(torch.nn.Module.to)  # type: ignore[method-assign]
    torch.Tensor.cpu = torch.Tensor.clone  # type: ignore[assignment] # from a card it is a copy, which agents change
    torch.cuda.set_device = lambda *_: None  # type: ignore[assignment]
    torch.cuda.synchronize = lambda *_: None  # type: ignore[assignment]
    for name in ("masked_fill", "masked_fill_"):  # as before torch 2, masks may be uint8
        fill = getattr(torch.Tensor, name)
        setattr(torch.Tensor, name, lambda self, mask, value, fill=fill: fill(self, mask.bool(), value))
    load = torch.load
    torch.load = lambda *given, **named: load(*given, **{"weights_only": False, **named})  # as before torch 2.6
    networkx.from_numpy_matrix = networkx.from_numpy_array  # as before networkx 3
    for old, new in {"float": float, "int": int, "bool": bool, "object": object}.items():
        if not hasattr(np, old):  # removed from numpy 1.24
            setattr(np, old, new)


def _write_networks(name: str) -> None:
    """Writes small networks with random weights into the working folder, under the names that the script asks for."""
    import torch
    import transformers  # type: ignore[import-not-found]

    bert = Path("bert-base-uncased")
    bert.mkdir()
    write_vocabulary(bert / "vocab.txt")
    sizes = {"hidden_size": 768, "num_hidden_layers": 2, "num_attention_heads": 12, "intermediate_size": 64}
    transformers.BertConfig(**sizes).save_pretrained(bert)
    torch.save({"unused": torch.zeros(1)}, bert / "pytorch_model.bin")
    if name == "recurrent-vln-bert":
        import pytorch_transformers  # type: ignore[import-not-found]
        from pytorch_transformers import modeling_bert, tokenization_bert

        sys.modules["transformers.pytorch_transformers"] = pytorch_transformers
        sys.modules["transformers.pytorch_transformers.modeling_bert"] = modeling_bert
        modeling_bert.BERT_PRETRAINED_CONFIG_ARCHIVE_MAP.clear()  # names are folders, not addresses
        tokenization_bert.BertTokenizer.max_model_input_sizes.clear()
        weights = Path("Prevalent/pretrained_model/pytorch_model.bin")
        weights.parent.mkdir(parents=True)
        torch.save({"bert.unused": torch.zeros(1)}, weights)
    if name == "navgpt2":
        _write_t5(Path("google/flan-t5-xl"))
        import timm.models.hub  # type: ignore[import-not-found]

        timm.models.hub.download_cached_file = lambda url, *_, **__: torch.save({"model": {}}, Path(url).name)
        timm.models.hub.get_cache_dir = lambda *_: "."
        # Created, then deleted by the agent, which reads features in its place.
        torch.nn.init.trunc_normal_ = lambda tensor, *_, **__: tensor


def _write_t5(folder: Path) -> None:
    import transformers
    from tokenizers import Tokenizer, models, pre_tokenizers  # type: ignore[import-not-found]

    words = {"<pad>": 0, "</s>": 1, "<unk>": 2, **{chr(33 + i): 3 + i for i in range(94)}}
    tokens = Tokenizer(models.WordLevel(words, "<unk>"))
    tokens.pre_tokenizer = pre_tokenizers.WhitespaceSplit()
    folder.mkdir(parents=True)
    tokens.save(str(folder / "tokenizer.json"))
    (folder / "tokenizer_config.json").write_text(json.dumps({"extra_ids": 0, "additional_special_tokens": []}))
    config = transformers.T5Config(
        vocab_size=128, d_model=64, d_kv=16, d_ff=64, num_layers=1, num_heads=4, decoder_start_token_id=0
    )
    transformers.T5ForConditionalGeneration(config).save_pretrained(folder, safe_serialization=False)


def write_vocabulary(path: Path) -> None:
    """Writes a vocab.txt with the places of BERT's special tokens, letters, and endings of one letter."""
    words = [f"[unused{i}]" for i in range(30522)]
    words[0] = "[PAD]"
    words[100:104] = "[UNK]", "[CLS]", "[SEP]", "[MASK]"
    pieces = [chr(i) for i in range(33, 127)] + [f"##{chr(i)}" for i in range(33, 127)]
    words[1000 : 1000 + len(pieces)] = pieces
    path.write_text("\n".join(words) + "\n")


class _Missing(MetaPathFinder, Loader):
    """Gives modules of stubs for packages that are not installed, which the script imports but does not need."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = set(names)

    def find_spec(self, fullname: str, path: object = None, target: object = None) -> ModuleSpec | None:
        missing = any(f"{fullname}.".startswith(f"{name}.") for name in self._names)
        return ModuleSpec(fullname, self, is_package=True) if missing else None

    def create_module(self, spec: ModuleSpec) -> types.ModuleType:
        class Module(types.ModuleType):
            def __getattr__(self, name: str) -> Any:
                return _stub(name)

        return Module(spec.name)

    def exec_module(self, module: types.ModuleType) -> None: ...


class _Stub(type):
    """A class whose attributes are stubs, too."""

    def __getattr__(cls, name: str) -> Any:
        return _stub(name)


def _stub(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    same = {"__init__": lambda *_, **__: None, "__call__": lambda self, *_, **__: self}
    return _Stub(name, (), {**same, "__getattr__": lambda _, inner: _stub(inner)})


if __name__ == "__main__":
    if sys.argv[1:2] == ["--inside"]:
        _inside(sys.argv[2], sys.argv[3], sys.argv[4:])
    elif sys.argv[1:2] == ["--load"]:
        _load(*sys.argv[2:])
    else:
        main()
