"""A text about the displayed model of a submap and its training. Does not use Qt."""

from __future__ import annotations

from app.state.loading import Contents

_TRAINS = ("train", "run", "demo")


def model_words(contents: Contents, submap: int) -> str:
    """The state of a submap's model, for example "trained, 2000 steps · training, step 430"."""
    info, step = contents.model_info.get(submap), contents.training.get(submap)
    if "train" in contents.former:
        words = "models of the previous submaps are shown"
    elif info is not None:
        steps = info.get("steps")
        words = f"trained, {steps} steps" if isinstance(steps, int) else "trained"
    else:
        words = "not trained" if step is None else "shown during training"
    if step is None:
        return words
    trains = any(job.state == "running" and job.stage in _TRAINS for job in contents.jobs)
    return f"{words} · {'training' if trains else 'unfinished training'}, step {step}"
