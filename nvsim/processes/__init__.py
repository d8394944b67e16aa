"""Processes that NVSim starts for one kind of work: typed requests in, typed answers out, within limits of time and
memory. Knows no file format."""
