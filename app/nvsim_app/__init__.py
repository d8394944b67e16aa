"""The desktop application: document, views, panels, and jobs. A thin layer over nvsim, which never imports it."""

from nvsim_app.singleton_refcounts import raise_singleton_refcounts

raise_singleton_refcounts()
