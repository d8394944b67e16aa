"""Data for `nvsim COMMAND --help`: common options of long commands, examples, and help of `--no-x` options."""

from __future__ import annotations

LIMIT = 25
"""Commands with at most this number of options show all of them in --help. Other commands need a row in COMMON."""

_CAPTURE = ("--scale", "--camera-height", "--up", "--images", "--axes", "--poses", "--hold-out")
_CORRIDOR = ("--criteria", "--tau-alpha", "--tau-normal", "--support", "--robot-radius", "--margin", "--no-both-ways")
_ENDPOINT = ("--endpoint", "--model", "--price-in", "--price-out", "--budget-money", "--yes")
_PATHS = ("--train", "--val-seen", "--val-unseen", "--joined", "--seed")

COMMON: dict[str, dict[str, tuple[str, ...]]] = {
    "demo": {
        "Project": ("--project", "--no-window", "--json"),
        "Building": ("--small", "--area", "--storeys", "--style", "--seed"),
        "Stages": ("--depth", "--floors.provider", "--submaps.count"),
        "Training": ("--preset", "--train.steps", "--train.image-size", "--train.gaussian-cap", "--train.device"),
        "Map": ("--map.robot-radius", "--map.tau-dist"),
    },
    "run": {
        "Project": ("--project", "--json"),
        "Capture": _CAPTURE,
        "Stages": ("--depth", "--floors.provider", "--submaps.count", "--executor"),
        "Training": ("--preset", "--device", "--train.steps", "--train.image-size", "--train.gaussian-cap"),
        "Map": ("--map.criteria", "--map.robot-radius", "--map.tau-dist", "--map.max-distance"),
        "The paper's method": ("--paper", "--paper-scale"),
    },
    "train": {
        "Project": ("--project", "--json", "--submaps", "--at-once"),
        "Size and time": ("--preset", "--paper-scale", "--steps", "--image-size", "--gaussian-cap"),
        "Machine": ("--device", "--threads", "--checkpoint-seconds", "--executor"),
        "Model": ("--no-background", "--no-texture", "--exposure", "--appearance.kind", "--robust.kind"),
        "Floor losses": ("--loss.suppression", "--loss.floor", "--loss.fill"),
    },
    "map": {
        "Project": ("--project", "--json", "--reapply", "--memory", "--backend"),
        "Method": ("--preset", "--paper", "--normal-source"),
        "Corridors": _CORRIDOR,
        "Search": ("--tau-dist", "--start", "--max-distance", "--max-viewpoints", "--merge-radius"),
    },
    "graph evidence": {
        "Graph": ("--project", "--graph", "--viewpoints", "--out", "--memory", "--json"),
        "Corridors": _CORRIDOR,
        "Search": ("--reach", "--tau-dist"),
    },
    "export tasks": {
        "Input and output": ("--scans", "--project", "--out", "--only", "--unseen", "--json"),
        "Paths": _PATHS,
        "Instructions": (
            "--instructions",
            "--register",
            "--no-landmarks",
            "--objects",
            "--vlnce",
            "--streamvln",
            "--rxr",
            "--goals",
        ),
        "Instructions by a vision-language model": _ENDPOINT,
    },
    "export dataset": {
        "Input and output": ("--project", "--also", "--out", "--force", "--dry-run", "--json"),
        "Agents": ("--for", "--vocabulary"),
        "Images and features": ("--size", "--views", "--features", "--projection"),
        "Tasks": (
            "--unseen",
            *_PATHS,
            "--instructions",
            "--register",
            "--no-landmarks",
            "--objects",
            "--vlnce",
            "--streamvln",
            "--rxr",
        ),
    },
    "r2r train": {
        "Input and output": ("--scans", "--project", "--out", "--tasks", "--features", "--json"),
        "Agent": ("--width", "--blind", "--panorama"),
        "Training": ("--iterations", "--a2c-iterations", "--batch", "--rate", "--dropout", "--seed", "--threads"),
        "Evaluation": ("--held-out", "--evaluate-every", "--patience", "--checkpoint-every"),
    },
    "r2r agent": {
        "Input and output": ("--scans", "--tasks", "--split", "--out", "--seed", "--json"),
        "Agent recurrent": ("--checkpoint", "--features"),
        "Agent mapgpt": (*_ENDPOINT, "--answers", "--steps", "--prompt"),
    },
    "evaluate validity-table": {
        "Input and output": ("--project", "--occupancy", "--map-frame", "--out", "--json"),
        "Table": ("--presets", "--columns", "--repeat", "--seed"),
        "Training": ("--steps", "--image-size", "--gaussian-cap"),
        "Map": ("--preset", "--robot-radius", "--tau-dist"),
    },
    "evaluate judge": {
        "Compared models": ("--project", "--presets", "--projects", "--folders", "--reference", "--submaps"),
        "Judges": ("--judges", "--key-variables", "--prices-in", "--prices-out", "--budget-money", "--yes"),
        "Views": ("--seen", "--novel", "--image-width", "--seed", "--truth", "--lpips"),
        "Training": ("--steps", "--gaussian-cap"),
        "Output": ("--out", "--json"),
    },
}
"""Command -> heading -> options, for commands with more than LIMIT options."""

_NO_STUB = "Do not write the stub of the scan ZMojNkEp431. VLN-DUET and Recurrent-VLN-BERT then fail to start."
WITHOUT: dict[str, str] = {
    "TrainingConfig.background": "Train without the network that fills transparent parts of the image.",
    "TrainingConfig.texture": "Train without a texture of the floor surface.",
    "TrainingConfig.antialiased": "Train without Mip-Splatting's opacity compensation. Renderings at another size then "
    "differ more.",
    "MappingConfig.both_ways": "Accept an edge if the corridor is free in one direction.",
    "MappingConfig.checked_merges": "Accept an edge to a viewpoint near the end of a corridor without testing the "
    "corridor to that viewpoint.",
    "MappingConfig.standing": "Accept start positions without known, free floor below them.",
    "MappingConfig.settle": "Keep the viewpoints of the search unchanged: do not thin, join or complete the graph.",
    "MappingConfig.second_opinion": "Accept an edge by the model of one submap, even if another submap was trained on "
    "the same place.",
    "ModelConfig.distances": "Hide the distances to candidates and of moves from the agent, as VLN↻BERT does.",
    "ExportScan.plans": "Do not draw floor plans.",
    **dict.fromkeys(("ExportScan.stub", "ExportR2R.stub", "ExportDataset.stub"), _NO_STUB),
    "TaskOptions.landmarks": "Write instructions without doorways, corridors, objects and the floor.",
    "BenchApp.train": "Skip the second measurement, during the training of a submap.",
    "BenchGraph.window": "Measure without a window.",
}
"""Option with the default True, as `Option.owner` names it -> what its flag `--no-x` does."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("nvsim demo --small", "nvsim demo --project shops.nvsim --area 6000 --no-window"),
    "run": (
        "nvsim run CAPTURE --project house.nvsim",
        "nvsim run walk.mp4 --project house.nvsim --camera-height 1.4",
    ),
    "check": ("nvsim check CAPTURE", "nvsim check walk.mp4"),
    "poses": ("nvsim poses walk.mp4 --out poses",),
    "import": (
        "nvsim import CAPTURE --project house.nvsim",
        "nvsim import more.mp4 --project house.nvsim --add",
        "nvsim import room.ply --project room.nvsim --camera-height 1.2",
    ),
    "submaps": ("nvsim submaps --project house.nvsim --count 4",),
    "depth": ("nvsim depth --project house.nvsim", "nvsim depth --project house.nvsim --depth always"),
    "floors": (
        "nvsim floors --project house.nvsim",
        "nvsim floors --project house.nvsim --provider hybrid",
    ),
    "train": (
        "nvsim train --project house.nvsim",
        "nvsim train --project house.nvsim --submaps 0 2 --steps 8000",
    ),
    "map": ("nvsim map --project house.nvsim", "nvsim map --project house.nvsim --reapply --tau-alpha 0.9"),
    "restore": ("nvsim restore --project house.nvsim", "nvsim restore map --project house.nvsim"),
    "panorama": (
        "nvsim panorama --project house.nvsim --at 2.0 1.5 1.6 --out view.png",
        "nvsim panorama --project house.nvsim --viewpoint ID --faces --out faces",
    ),
    "graph select": (
        'nvsim graph select house.nvsim "length > 5"',
        'nvsim graph select FILE_connectivity.json "degree > 4 and not reviewed"',
    ),
    "graph edit": (
        'nvsim graph edit house.nvsim remove_edges --where "length > 5" --dry-run',
        'nvsim graph edit FILE remove_edges --where "length > 5" --out pruned_connectivity.json',
    ),
    "graph replay": ("nvsim graph replay house.nvsim curated.jsonl",),
    "graph log": ("nvsim graph log house.nvsim --script curated.jsonl",),
    "graph check": ("nvsim graph check house.nvsim", "nvsim graph check connectivity"),
    "graph propose": ("nvsim graph propose house.nvsim --script proposed.jsonl",),
    "graph review": ("nvsim graph review house.nvsim --count 20",),
    "graph compare": ("nvsim graph compare A B", "nvsim graph compare A B --out merged_connectivity.json"),
    "graph evidence": ("nvsim graph evidence --project house.nvsim",),
    "splat clean": ("nvsim splat clean room.nvsim", "nvsim splat clean room.nvsim --apply"),
    "occupancy build": (
        "nvsim occupancy build --project house.nvsim",
        "nvsim occupancy build CAPTURE --out maps/house.yaml",
    ),
    "occupancy compare": ("nvsim occupancy compare maps/house.yaml true.yaml",),
    "video": ("nvsim video --project house.nvsim --path path.json --out frames",),
    "export r2r": ("nvsim export r2r --project house.nvsim --out connectivity",),
    "export scan": (
        "nvsim export scan --project house.nvsim --out scans --views --dry-run",
        "nvsim export scan --project house.nvsim --out scans --views",
    ),
    "r2r python": ("nvsim r2r python -- python train.py --batch 8",),
    "r2r train": ("nvsim r2r train --scans scans --out agent", "nvsim r2r train --scans scans --out blind --blind"),
    "r2r agent": (
        "nvsim r2r agent random --scans scans --split val_unseen --out random.json",
        "nvsim r2r agent recurrent --checkpoint agent --scans scans --split val_unseen --out agent.json",
    ),
    "r2r path": ("nvsim r2r path",),
    "export graph": (
        "nvsim export graph house.nvsim --out house.graphml",
        "nvsim export graph house.nvsim --format svg --out house.svg",
    ),
    "export splats": ("nvsim export splats --project house.nvsim --out splats --format spz",),
    "export candidates": ("nvsim export candidates scans",),
    "export habitat": ("nvsim export habitat scans --project house.nvsim --out scenes",),
    "export features": (
        "nvsim export features scans --layout vit-b16",
        "nvsim export features scans --layout clip-b16 --model clip.onnx",
    ),
    "export tasks": (
        "nvsim export tasks --scans scans --out tasks",
        "nvsim export tasks --scans scans --unseen houseC --joined 50",
    ),
    "export reviewed": ("nvsim export reviewed tasks --out curated",),
    "export dataset": (
        "nvsim export dataset --project house.nvsim --out dataset --dry-run",
        "nvsim export dataset --project house.nvsim --out dataset",
        "nvsim export dataset --project house.nvsim --out dataset --for duet --vocabulary vocab.txt",
    ),
    "evaluate views": ("nvsim evaluate views --project house.nvsim --csv views.csv",),
    "evaluate ablation": ("nvsim evaluate ablation --project house.nvsim",),
    "evaluate floor": ("nvsim evaluate floor --project house.nvsim --truth masks",),
    "evaluate normals": ("nvsim evaluate normals --project house.nvsim --truth normals",),
    "evaluate depth": ("nvsim evaluate depth --project house.nvsim --truth depth",),
    "evaluate graph": ("nvsim evaluate graph --project house.nvsim --occupancy map.yaml --picture graph.png",),
    "evaluate calibration": ("nvsim evaluate calibration --project house.nvsim --occupancy map.yaml",),
    "evaluate validity-table": ("nvsim evaluate validity-table --project house.nvsim --occupancy map.yaml",),
    "evaluate scan": ("nvsim evaluate scan scans --project house.nvsim",),
    "evaluate r2r": (
        "nvsim evaluate r2r --scans scans --tasks tasks/R2R_val_unseen.json --submission agent.json",
        "nvsim evaluate r2r --scans scans --tasks tasks/R2R_val_unseen.json --agents shortest random",
    ),
    "evaluate judge": (
        "nvsim evaluate judge --project house.nvsim",
        "nvsim evaluate judge --project house.nvsim --judges gpt-5@https://api.openai.com/v1",
    ),
    "bench render": ("nvsim bench render --gaussians 200000",),
    "bench opengl": ("nvsim bench opengl --project house.nvsim",),
    "bench startup": ("nvsim bench startup",),
    "bench app": ("nvsim bench app --project house.nvsim",),
    "bench train": ("nvsim bench train --preset nvsim",),
    "bench depth": ("nvsim bench depth --frames 10",),
    "bench perception": ("nvsim bench perception --images 5",),
    "bench panorama": ("nvsim bench panorama --project house.nvsim",),
    "bench graph": ("nvsim bench graph --viewpoints 2000",),
    "bench simulator": ("nvsim bench simulator --project house.nvsim",),
    "bench map": ("nvsim bench map",),
    "models": ("nvsim models",),
    "models add": ("nvsim models add network.onnx --name mine",),
    "models train": ("nvsim models train FOLDER --steps 3000",),
    "models check": ("nvsim models check",),
    "app": ("nvsim app house.nvsim", "nvsim app connectivity/"),
}
"""One or two command lines for the end of each help."""
