"""The part of `nvsim export tasks --endpoint` that asks a model for instructions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nvsim.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from nvsim.cli.commands.export_tasks import Arguments
    from nvsim.events import Listener
    from nvsim.graph.types import NavGraph
    from nvsim.r2r.tasks.splitting import Dataset

_ANSWERS = "answers"


def asked_instructions(
    a: Arguments, listen: Listener, dataset: Dataset, graphs: Sequence[NavGraph]
) -> tuple[Dataset, dict[str, Any]]:
    """The dataset with instructions of the model, and their description for tasks.json. The description names the
    model, the generated instructions that were replaced, and the paths that keep generated ones and why.

    Raises InputError if there are no images to send, the user does not agree, or the endpoint does not answer."""
    from nvsim.cli.consent import agree
    from nvsim.endpoint.answer import Kept
    from nvsim.endpoint.client import Client
    from nvsim.r2r.prompted.instructions import Writer, read_prompt
    from nvsim.r2r.prompted.views import ViewRenderer
    from nvsim.r2r.tasks.splitting import replace_instructions

    if a.instructions == 0:
        raise InputError(
            "--endpoint asks for instructions, but --instructions 0 excludes them; drop one of the two options."
        )
    prompt, endpoint, budget = read_prompt(a.prompt), a.asked.address(), a.asked.budget(a.asking)
    place = a.scans or a.project
    assert place is not None
    tasks = [task for split in dataset.splits.values() for task in split]
    by_scan = {graph.scan: graph for graph in graphs}
    renderer = ViewRenderer(place, a.looking)
    kept = Kept(a.asked.answers or a.out / _ANSWERS)
    client = Client(endpoint, kept, budget, a.asking, listen)
    try:
        writer = Writer(renderer, by_scan, prompt, a.instructions, a.asking.answer_tokens, a.asking.detail)
        note = (
            "NVSim sends views along the paths, turns and distances. If an answer is unusable, it asks again, "
            "at most twice."
        )
        client.may_send = agree([(endpoint, writer.estimate(client, tasks), budget.prices)], [note], a.asking.yes)
        written = writer.write(client, tasks, a.asking.parallel, listen)
    finally:
        client.close()
        renderer.close()
    about = {
        "url": endpoint.url,
        "model": endpoint.model,
        "prompt": prompt.path.name,
        "prompt_sha256": prompt.sha256,
        "paths": len(written.found),
        "tokens_in": budget.tokens_in,
        "tokens_out": budget.tokens_out,
        "price": budget.money,
        "asked": budget.asked,
        "answers_used_again": budget.used_again,
        "generated_instead": {str(id): said.why for id, said in written.lacking.items()},
        "generated": {str(t.path_id): list(t.instructions) for t in tasks if t.path_id in written.found},
    }
    return replace_instructions(dataset, written.found), about
