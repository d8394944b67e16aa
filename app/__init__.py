"""The desktop application: document, views, panels, jobs. Thin over nvsim; nvsim never imports it."""
