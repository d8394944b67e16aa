"""The desktop application: document, views, panels, jobs. Thin over nvsim; nvsim never imports it."""

from app.immortal import protect

protect()
