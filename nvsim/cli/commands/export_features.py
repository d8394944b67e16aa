"""Write features of the 36 views of every viewpoint of exported scans, in the files that agents read, with any ONNX
network or the built-in features. Run it again to continue an interrupted run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from nvsim.cli.arguments import Positional
from nvsim.cli.console import listening
from nvsim.cli.terminal import say
from nvsim.errors import InputError
from nvsim.events import Warning
from nvsim.networks.onnx_session import Provider
from nvsim.r2r.features.layouts import LAYOUTS, Name


@dataclass(frozen=True)
class Arguments:
    export: Positional[Path | None] = None
    """The folder of an export: connectivity/ with scans.txt, and views/ or skybox strips."""
    folder: Path | None = None
    """The folder of an export, as a named option. Default: `scans` next to the project."""
    project: Path | None = None
    """The project of the scan, if the command runs as a job of that project."""
    layout: tuple[Name, ...] = ("vit-b16",)
    """resnet-152: TSV of EnvDrop and Recurrent-VLN-BERT; vit-b16: HAMT and VLN-DUET; clip-b16: ScaleVLN and SAME;
    clip-h14: ScaleVLN; eva-l14: NaviLLM; eva-g: LMDB of NavGPT-2. You can name several."""
    model: Path | None = None
    """An ONNX network with a description next to it (CLIP.onnx, CLIP.toml). Default: features.LAYOUT.onnx in the models
    folder, else an ImageNet network (the extra `features`), else a fixed projection of colors and edges."""
    projection: bool = False
    """Use the fixed projection of colors and edges, even if a network is available."""
    out: Path | None = None
    """The output folder. Default: `features` in the export."""
    scans: tuple[str, ...] = ()
    """Scans to include. Default: all that scans.txt lists and that have images."""
    batch: int = 12
    """Number of images per batch of an ONNX network, if the network allows any number."""
    provider: Provider = "auto"
    """Device of an ONNX network: CUDA if onnxruntime supports it, else the CPU."""
    json: bool = False
    """Print events, one JSON object per line."""


def run(arguments: Arguments) -> int:
    """Runs the command. Raises InputError if options are invalid or contradict each other."""
    from nvsim.r2r.features.candidate_views import extract_candidates
    from nvsim.r2r.features.exported_scan import read_exported_scans
    from nvsim.r2r.features.extraction import STAGE, extract, with_images
    from nvsim.r2r.features.network import choose_backbone

    a = arguments
    if not 1 <= a.batch <= 1024:
        raise InputError(f"--batch {a.batch} is out of range; give 1 to 1024.")
    if a.model is not None and a.projection:
        raise InputError("--model and --projection exclude each other; give one.")
    if a.export is not None and a.folder is not None:
        raise InputError(f"The export is named twice, {a.export} and --folder {a.folder}; name it once.")
    export = a.export or a.folder or (a.project and a.project.absolute().parent / "scans")
    if export is None:
        raise InputError("No export is named; give the folder that `nvsim export scan` wrote.")
    written = []
    with listening(a.json) as listen:
        scans = with_images(read_exported_scans(export, a.scans), bool(a.scans), listen)
        for name in dict.fromkeys(a.layout):
            backbone, warning = choose_backbone(LAYOUTS[name], a.model, a.batch, a.provider, a.projection)
            if warning:
                listen(Warning(warning, STAGE))
            make = extract_candidates if LAYOUTS[name].tokens else extract
            written += make(scans, LAYOUTS[name], backbone, a.out or export / "features", listen)
    if not a.json:
        say(*(f"Wrote {path}" for path in written))
    return 0
