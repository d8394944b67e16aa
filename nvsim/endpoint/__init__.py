"""Client for vision-language models over HTTP: requests, budgets, retries, and answers stored on disk. Nothing is sent
unless a caller names an endpoint. This package does not depend on projects or graphs."""
