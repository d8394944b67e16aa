"""Where pieces of work run: in processes of this machine, or on the machines of a Ray cluster. One interface, so that a
stage says what its pieces are and not where they are done. Knows nothing of submaps, frames and projects."""
