"""What language models that see are asked about scans: instructions for a path, and where to go next. Sends nothing but
through `nvsim.endpoint`."""
