"""Tasks for vision-language models: to write instructions for paths, and to navigate. Uses `nvsim.endpoint` to send."""
