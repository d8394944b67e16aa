"""One module per command: an Arguments dataclass and a function `run(arguments) -> exit code`."""
