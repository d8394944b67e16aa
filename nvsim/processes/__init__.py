"""Child processes that answer typed requests within limits of time and memory. Independent of file formats."""
