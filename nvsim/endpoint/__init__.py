"""Questions to language models that see, over HTTP: what is asked, what it may cost, how it is asked again, and the
answers kept on disk. Sends nothing unless a caller names an endpoint. Knows no project and no graph."""
