"""Estimate dense depth from the images and their poses, and fuse it into a point cloud that replaces a scan. If the
capture has a scan, nothing is done unless you request it."""

from __future__ import annotations

from dataclasses import dataclass, field

from nvsim.cli.arguments import Inline, ProjectArguments
from nvsim.cli.session import working
from nvsim.cluster.choice import opened
from nvsim.cluster.config import ClusterConfig
from nvsim.depth.config import DepthConfig
from nvsim.project.config import DepthUse
from nvsim.project.stages import depths


@dataclass(frozen=True)
class Arguments(ProjectArguments):
    depth: DepthUse = "auto"
    """auto: only if the capture has no scan; always: also fills holes of a scan but never overrides it; or never."""
    cluster: Inline[ClusterConfig] = field(default_factory=ClusterConfig)
    config: Inline[DepthConfig] = field(default_factory=DepthConfig)


def run(arguments: Arguments) -> int:
    cluster = arguments.cluster
    with opened(cluster) as executor, working(arguments.project, "depth", arguments.json) as (project, listen):
        depths.run(project, arguments.depth, arguments.config, listen, executor, cluster.storage)
    return 0
