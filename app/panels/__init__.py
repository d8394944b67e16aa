"""One panel per file; each renders from the document and owns nothing else."""
