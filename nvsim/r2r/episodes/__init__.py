"""Tasks as episodes for agents that move through space in small steps: which actions follow a path without touching
anything, and the files of VLN-CE and StreamVLN. Knows no simulator of theirs."""
