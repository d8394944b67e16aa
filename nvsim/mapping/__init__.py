"""Region of interest, criteria and the breadth-first builder (paper Algorithm 1). Knows no files."""
