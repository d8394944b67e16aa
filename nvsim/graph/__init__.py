"""The navigation graph: the immutable NavGraph, its edits, history, checks, exports, and R2R connectivity files."""
