"""NavGraph (immutable), edits, difference, checks, R2R connectivity files. Knows no pixels."""
